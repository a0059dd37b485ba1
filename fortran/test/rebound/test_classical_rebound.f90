! SPDX-License-Identifier: BSD-3-Clause
!> Classical rebounds: values computed by hand, limiting cases, and no gain of energy.
program test_classical_rebound
   use rockfall_kinds, only: wp, i8
   use rockfall_math, only: degree, tangent
   use rockfall_random, only: normal_table_t, normal_table, rebound_words
   use rockfall_boulder, only: boulder_t, inertia_factor
   use rockfall_impact, only: rebound_t, twice_energy
   use rockfall_classical_rebound, only: scatter_t, scatter, drawn_coefficient, classical_t, classical_rebound, &
                                         lengthen_hop, penetration, &
      absorbs, rockyfor3d, pfeiffer_bowen, bourrier_hungr, constant, absorbing
   use check_m, only: check, check_close, finish
   implicit none

   real(wp), parameter :: near = 1.0e-14_wp
   !> Boulder of 1 m diameter, for which N = m/(rho_soil B d**3) is 1 in soil of 1000 kg/m3.
   type(boulder_t), parameter :: boulder = boulder_t(radius=0.5_wp, mass=1200.0_wp)
   integer(i8), parameter :: middle(rebound_words) = 2_i8**31  !! random words without deviation
   type(normal_table_t) :: table

   call random_init(.true., .false.)
   table = normal_table()
   call test_by_hand()
   call test_sticking_and_sliding()
   call test_penetration()
   call test_absorbing()
   call test_ends_of_restitution()
   call test_limits()
   call test_energy()
   call test_scatter()
   call test_roughness()
   call test_hops()
   call test_inertia()
   call finish()

contains

   !> Ground without scatter, with given R_n or half speed, and R_t.
   pure type(classical_t) function ground(model, normal, tangential)
      integer, intent(in) :: model
      real(wp), intent(in) :: normal, tangential

      ground = classical_t(model, scatter(table, normal, 0.0_wp, [0.0_wp, 1.0_wp]), &
                           scatter(table, tangential, 0.0_wp, [0.0_wp, 1.0_wp]), tangent(30.0_wp), 1000.0_wp, 0.1_wp, &
                           0.0_wp, 0.0_wp)
   end function ground

   !> V_t, V_n, W after a rebound, with obstacles of 0.2 m.
   function after(this, v_in, forced) result(v)
      type(classical_t), intent(in) :: this
      real(wp), intent(in) :: v_in(3)
      logical, intent(in) :: forced
      real(wp) :: v(3)
      type(rebound_t) :: out

      call classical_rebound(this, table, middle, 0.5_wp, boulder, inertia_factor, 0.2_wp, v_in, out)
      call check("forced, or not", out%forced .eqv. forced)
      call check("a single draw", out%draws == 1)
      v = out%v
   end function after

   subroutine test_by_hand()
      real(wp), parameter :: v_in(3) = [10.0_wp, -5.0_wp, 8.0_wp]

      call same("rockyfor3d", after(ground(rockyfor3d, 0.38_wp, 0.0_wp), v_in, .false.), &
                [7.694267072777097_wp, 1.4626663893265701_wp, 7.694267072777097_wp], 1.0e-9_wp)
      call same("pfeiffer_bowen", after(ground(pfeiffer_bowen, 0.35_wp, 0.8_wp), v_in, .false.), &
                [8.128476396267287_wp, 1.3471927270113147_wp, 8.128476396267287_wp], near)
      call same("constant", after(ground(constant, 0.4_wp, 0.9_wp), v_in, .false.), [9.0_wp, 2.0_wp, 7.2_wp], near)
   end subroutine test_by_hand

   !> Bourrier and Hungr: the boulder rolls where friction suffices, slides otherwise, and the transition is continuous.
   subroutine test_sticking_and_sliding()
      type(classical_t) :: this
      real(wp) :: limit, v(3), w(3)

      this = ground(bourrier_hungr, 5.0_wp, 0.9_wp)
      call same("sticks", after(this, [10.0_wp, -5.0_wp, 8.0_wp], .false.), [8.485714285714286_wp, 2.5_wp, &
            8.485714285714286_wp], near)
      call same("slides", after(this, [10.0_wp, -5.0_wp, -20.0_wp], .false.), &
                [4.669872981077807_wp, 2.5_wp, -7.174682452694519_wp], near)
      limit = 10 - this%friction*1.5_wp*5*3.5_wp/0.9_wp  ! limit for W
      v = after(this, [10.0_wp, -5.0_wp, limit + 1.0e-9_wp], .false.)
      w = after(this, [10.0_wp, -5.0_wp, limit - 1.0e-9_wp], .false.)
      call check("sticking and sliding meet", all(abs(v - w) < 1.0e-8_wp))
      call same("overspun, it is sped up", after(this, [1.0_wp, -5.0_wp, 30.0_wp], .false.), &
                [0.9_wp + this%friction*7.5_wp, 2.5_wp, 27 - this%friction*7.5_wp/0.4_wp], near)
   end subroutine test_sticking_and_sliding

   subroutine test_penetration()
      call check_close("medium soil", penetration(boulder, 1000.0_wp, 0.38_wp, 125.0_wp), 0.057699663424872524_wp, &
            1.0e-9_wp)
      call check_close("soft soil", penetration(boulder, 1000.0_wp, 0.23_wp, 125.0_wp), 0.322220674577689_wp, 1.0e-9_wp)
      call check_close("at most the radius", penetration(boulder, 1000.0_wp, 0.1_wp, 125.0_wp), 0.5_wp, near)
      call check_close("at any speed", penetration(boulder, 1000.0_wp, 0.01_wp, 1.0e12_wp), 0.5_wp, near)
      call check_close("at rest: none", penetration(boulder, 1000.0_wp, 0.38_wp, 0.0_wp), 0.0_wp, near)
   end subroutine test_penetration

   subroutine test_absorbing()
      call check("water absorbs", absorbs(classical_t(absorbing), 0.0_wp))
      call check("so do obstacles of 100 m", absorbs(classical_t(rockyfor3d), 100.0_wp))
      call check("not lower ones", .not. absorbs(classical_t(rockyfor3d), 99.0_wp))
      call check("nor where obstacles do not count", .not. absorbs(classical_t(constant), 100.0_wp))
   end subroutine test_absorbing

   subroutine test_ends_of_restitution()
      real(wp), parameter :: v_in(3) = [10.0_wp, -5.0_wp, 8.0_wp]
      real(wp) :: v(3)

      call same("elastic", after(ground(constant, 1.0_wp, 1.0_wp), v_in, .false.), [10.0_wp, 5.0_wp, 8.0_wp], near)
      v = after(ground(constant, 0.0_wp, 0.9_wp), v_in, .true.)
      call check_close("without restitution it is lifted at 1 % of its speed", v(2), 0.01_wp*sqrt(125.0_wp), near)
      v = after(ground(constant, 0.4_wp, 0.0_wp), v_in, .false.)
      call same("stopped along the ground", v, [0.0_wp, 2.0_wp, 0.0_wp], near)
      v = after(ground(bourrier_hungr, 1.0e9_wp, 1.0_wp), v_in, .false.)
      call check_close("hard ground gives V_n back", v(2), 5.0_wp, 1.0e-8_wp)
   end subroutine test_ends_of_restitution

   !> A non-spherical boulder keeps its rotational energy, which W represents, rolls on with R omega = V_t, and
   !> transfers more energy to rotation.
   subroutine test_inertia()
      real(wp), parameter :: inertia = 0.6_wp, v_in(3) = [10.0_wp, -5.0_wp, 8.0_wp]
      real(wp) :: share, sphere(3)
      type(rebound_t) :: out

      call classical_rebound(ground(constant, 0.5_wp, 1.0_wp), table, middle, 0.5_wp, boulder, inertia, 0.2_wp, v_in, &
                             out)
      call check_close("nothing is lost along the ground", out%v(1), v_in(1), near)
      call check_close("nor of the rotation", out%v(3), v_in(3), near)
      sphere = after(ground(rockyfor3d, 0.38_wp, 0.0_wp), v_in, .false.)
      call classical_rebound(ground(rockyfor3d, 0.38_wp, 0.0_wp), table, middle, 0.5_wp, boulder, inertia, 0.2_wp, &
                             v_in, out)
      call check_close("rolls", out%v(3)*sqrt(inertia_factor/inertia), out%v(1), near)
      share = (sphere(1)**2 + inertia_factor*sphere(3)**2)/(v_in(1)**2 + inertia_factor*v_in(3)**2)
      call check_close("the same share of the energy is left", out%v(1)**2 + inertia_factor*out%v(3)**2, &
                       share*(v_in(1)**2 + inertia_factor*v_in(3)**2), near)
      call check_close("of which more is rotation", out%v(1)**2/sphere(1)**2, (1 + inertia_factor)/(1 + inertia), near)
   end subroutine test_inertia

   !> Very fast and very slow, vertical and along the ground.
   subroutine test_limits()
      integer, parameter :: models(4) = [rockyfor3d, pfeiffer_bowen, bourrier_hungr, constant]
      real(wp), parameter :: speeds(4) = [1.0e-12_wp, 1.0e-3_wp, 1.0e3_wp, 1.0e9_wp]
      real(wp) :: v(3), v_in(3)
      type(rebound_t) :: out
      integer :: k, l

      do k = 1, size(models)
         do l = 1, size(speeds)
            v_in = [0.0_wp, -speeds(l), 0.0_wp]
            call classical_rebound(ground(models(k), 0.4_wp, 0.8_wp), table, middle, 0.5_wp, boulder, inertia_factor, &
                                   0.2_wp, v_in, out)
            call check("straight down it goes straight up", out%v(2) > 0 .and. all(abs(out%v([1, 3])) <= 0))
            v_in = speeds(l)*[1.0_wp, 0.0_wp, 0.0_wp]
            call classical_rebound(ground(models(k), 0.4_wp, 0.8_wp), table, middle, 0.5_wp, boulder, inertia_factor, &
                                   0.2_wp, v_in, out)
            call check("along the ground it is lifted", out%forced .and. out%v(2) > 0)
            call check("without more energy", twice_energy(out%v) <= twice_energy(v_in)*(1 + near))
         end do
      end do
      v = after(ground(pfeiffer_bowen, 0.4_wp, 0.8_wp), [0.0_wp, -9.144_wp, 0.0_wp], .false.)
      call check_close("30 ft/s halve R_n", v(2), 0.2_wp*9.144_wp, near)
      v = after(ground(bourrier_hungr, 5.0_wp, 0.8_wp), [0.0_wp, -5.0_wp, 0.0_wp], .false.)
      call check_close("the half speed halves it, too", v(2), 2.5_wp, near)
   end subroutine test_limits

   !> No gain of energy for any incoming velocity, coefficients and random words.
   subroutine test_energy()
      integer, parameter :: models(4) = [rockyfor3d, pfeiffer_bowen, bourrier_hungr, constant]
      type(classical_t) :: this
      type(rebound_t) :: out
      integer(i8) :: words(rebound_words)
      real(wp) :: u(20), v_in(3)
      integer :: k, n
      logical :: kept, rises

      do k = 1, size(models)
         kept = .true.
         rises = .true.
         do n = 1, 20000
            call random_number(u)
            words = int(u(:3)*2.0_wp**32, i8)
            this%model = models(k)
            this%normal = scatter(table, 0.01_wp + 0.99_wp*u(10), u(11), [0.01_wp, 1.0_wp])
            this%tangential = scatter(table, u(12), u(13), [0.0_wp, 1.0_wp])
            this%friction = tangent(80*u(14))
            this%soil_density = 500 + 2000*u(15)
            this%obstacle_spread = u(16)
            this%roughness = 0.78_wp*u(20)*merge(1, 0, mod(n, 2) == 0)
            v_in = [10**(6*u(17) - 3), -10**(6*u(18) - 3), 40*u(19) - 20]
            call classical_rebound(this, table, words, u(4), boulder, inertia_factor, u(20), v_in, out)
            kept = kept .and. twice_energy(out%v) <= twice_energy(v_in)*(1 + near)
            rises = rises .and. out%v(2) > 0
         end do
         call check("no rebound gains energy", kept)
         call check("every rebound rises", rises)
      end do
   end subroutine test_energy

   !> Drawn coefficients are normal, within their limits, and reach them.
   subroutine test_scatter()
      type(scatter_t) :: this
      real(wp) :: mean, square, value, u
      integer :: n
      integer, parameter :: many = 200000

      this = scatter(table, 0.38_wp, 0.02_wp, [0.34_wp, 0.42_wp])
      call check("the first word gives the lower end", abs(drawn_coefficient(this, table, 0_i8) - 0.34_wp) < 1.0e-9_wp)
      call check("the last the upper", abs(drawn_coefficient(this, table, 2_i8**32 - 1) - 0.42_wp) < 1.0e-9_wp)
      call check("none lies beyond them", drawn_coefficient(this, table, 0_i8) >= 0.34_wp &
                 .and. drawn_coefficient(this, table, 2_i8**32 - 1) <= 0.42_wp)
      call check_close("the middle one is the mean", drawn_coefficient(this, table, 2_i8**31), 0.38_wp, 1.0e-9_wp)
      mean = 0
      square = 0
      do n = 1, many
         call random_number(u)
         value = drawn_coefficient(this, table, int(u*2.0_wp**32, i8))
         mean = mean + value
         square = square + (value - 0.38_wp)**2
      end do
      ! a normal distribution truncated at two standard deviations has 0.879626 of its standard deviation
      call check("mean", abs(mean/many - 0.38_wp) < 4*0.0176_wp/sqrt(real(many, wp)))
      call check_close("standard deviation", sqrt(square/many), 0.02_wp*0.8796256610342398_wp, 0.01_wp)
      this = scatter(table, 0.5_wp, 1.0e6_wp, [0.0_wp, 1.0_wp])
      call check_close("a wide one is uniform", drawn_coefficient(this, table, 2_i8**30), 0.25_wp, 1.0e-3_wp)
      this = scatter(table, 0.5_wp, 0.1_wp, [0.5_wp, 0.5_wp])
      call check_close("ends that meet leave one number", drawn_coefficient(this, table, 7_i8), 0.5_wp, near)
      this = scatter(table, 0.5_wp, 0.0_wp, [0.0_wp, 1.0_wp])
      call check_close("so does no deviation", drawn_coefficient(this, table, 7_i8), 0.5_wp, near)
   end subroutine test_scatter

   !> A sphere falling vertically on ground tilted by half of 20 degrees leaves at twice the tilt, backwards, if no
   !> energy is lost. A motion along the ground is deflected away from it.
   subroutine test_roughness()
      type(classical_t) :: this
      real(wp), parameter :: tilt = 10*degree

      this = ground(constant, 1.0_wp, 1.0_wp)
      this%roughness = 2*tilt
      call same("straight down", after(this, [0.0_wp, -5.0_wp, 0.0_wp], .false.), &
                [-5*sin(2*tilt), 5*cos(2*tilt), 0.0_wp], 1.0e-9_wp)
      call same("along the ground", after(this, [5.0_wp, 0.0_wp, 3.0_wp], .false.), &
                [5*cos(2*tilt), 5*sin(2*tilt), 3.0_wp], 1.0e-9_wp)
      this = ground(rockyfor3d, 0.38_wp, 0.0_wp)
      this%roughness = 2*tilt
      call check("back is back for a model of energies, too", minval(after(this, [0.0_wp, -5.0_wp, 0.0_wp], &
            .false.)) < 0)
   end subroutine test_roughness

   !> A rolling boulder hops by its radius, using its own energy; a boulder that is too slow, or hops farther anyway, is
   !> unchanged.
   subroutine test_hops()
      type(classical_t) :: this
      real(wp), parameter :: pull = 8.0_wp
      real(wp) :: v(3)

      this%min_hop = 1
      v = [5.0_wp, 0.01_wp, 3.0_wp]
      call lengthen_hop(this, boulder, pull, v)
      call check_close("so far", 2*v(1)*v(2)/pull, boulder%radius, near)
      call check_close("with the same energy", v(1)**2 + v(2)**2, 25 + 0.01_wp**2, near)
      call check("flat, and not steep", v(2) < v(1))
      v(1) = -v(1)
      v(2) = 0
      call lengthen_hop(this, boulder, pull, v)
      call check("backwards as well", v(1) < 0 .and. v(2) > 0)
      v = [5.0_wp, 0.5_wp, 3.0_wp]
      call lengthen_hop(this, boulder, pull, v)
      call same("far enough", v, [5.0_wp, 0.5_wp, 3.0_wp], 0.0_wp)
      v = [1.9_wp, 0.1_wp, 3.0_wp]
      call lengthen_hop(this, boulder, pull, v)
      call same("too slow", v, [1.9_wp, 0.1_wp, 3.0_wp], 0.0_wp)
      this%min_hop = 0
      v = [5.0_wp, 0.01_wp, 3.0_wp]
      call lengthen_hop(this, boulder, pull, v)
      call same("not asked for", v, [5.0_wp, 0.01_wp, 3.0_wp], 0.0_wp)
   end subroutine test_hops

   subroutine same(name, got, want, relative)
      character(len=*), intent(in) :: name
      real(wp), intent(in) :: got(3), want(3), relative
      integer :: k

      do k = 1, 3
         call check_close(name, got(k), want(k), relative)
      end do
   end subroutine same
end program test_classical_rebound
