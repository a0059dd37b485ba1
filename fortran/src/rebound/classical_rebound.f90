! SPDX-License-Identifier: BSD-3-Clause
!> Rebounds by coefficients of restitution, as used in practice for ground without rocks: meadow, road, rock face. Each
!> model computes V_t, V_n, W after an impact from their values before; W = R_b omega, > 0 for forward rolling, so the
!> contact point slides at V_t - W. Coefficients scatter from rebound to rebound.
module rockfall_classical_rebound
   use rockfall_kinds, only: wp, i8
   use rockfall_math, only: pi, sine_cosine
   use rockfall_random, only: normal_table_t, normal, uniform, rebound_words, normal_restitution_word, &
                              tangential_restitution_word, obstacle_spread_word
   use rockfall_boulder, only: boulder_t, inertia_factor
   use rockfall_impact, only: rebound_t, is_admissible, limit_rebound
   implicit none
   private
   public :: scatter_t, scatter, drawn_coefficient, classical_t, classical_rebound, lengthen_hop, penetration, absorbs
   public :: by_sets, rockyfor3d, pfeiffer_bowen, bourrier_hungr, constant, absorbing, by_table, by_ratio_table

   !> Rebound models: impact sets (rockfall_impact); the models of this module; no rebound, so that
   !> the boulder stays; or a table (rockfall_impact_table), with or without parts for R_b/R_m.
   integer, parameter :: by_sets = 1, rockyfor3d = 2, pfeiffer_bowen = 3, bourrier_hungr = 4, constant = 5, &
                         absorbing = 6, by_table = 7, by_ratio_table = 8

   !> Rockyfor3D marks areas that no boulder leaves, such as lakes, by this obstacle height [m].
   real(wp), parameter :: absorbing_obstacle = 100.0_wp

   !> Speeds of Pfeiffer and Bowen (1989) [m/s]: 30, 20 and 250 ft/s.
   real(wp), parameter :: normal_speed = 9.144_wp, friction_speed = 6.096_wp, scaling_speed = 76.2_wp
   real(wp), parameter :: friction_offset = 1.2_wp  !! constant of Pfeiffer and Bowen [-]

   !> Parameters of Pichler et al. (2005) as in Rockyfor3D: nose shape of a sphere and compressibility of soils [-];
   !> indentation resistance of ground with R_n = 1 [Pa].
   real(wp), parameter :: nose = 0.707_wp, compressibility = 1.2_wp, indentation_resistance = 55.0e9_wp

   !> Truncated normal variable, drawn at each rebound.
   type :: scatter_t
      real(wp) :: mean = 0.0_wp, std = 0.0_wp
      real(wp) :: first = 0.0_wp, words = 0.0_wp  !! first random word within the limits; number of such words
   end type scatter_t

   !> Classical rebound. Components not used by its model keep their defaults.
   type :: classical_t
      integer :: model = by_sets
      type(scatter_t) :: normal = scatter_t()      !! R_n [-]; for bourrier_hungr the speed at which R_n is 1/2 [m/s]
      type(scatter_t) :: tangential = scatter_t()  !! R_t [-]; for rockyfor3d computed from obstacles and penetration
      real(wp) :: friction = 0.0_wp   !! tangent of the friction angle [-]
      real(wp) :: soil_density = 0.0_wp      !! [kg/m3]
      real(wp) :: obstacle_spread = 0.0_wp  !! maximum relative deviation of obstacle heights [-]
      real(wp) :: roughness = 0.0_wp  !! maximum tilt of the ground [rad]
      real(wp) :: min_hop = 0.0_wp    !! minimum length of a hop, over the boulder's radius; 0: none [-]
   end type classical_t

contains

   !> Normal variable truncated to limits that contain the mean. The variable increases with its random word, so the
   !> limits correspond to a range of words, found by bisection without functions of the system's library.
   pure type(scatter_t) function scatter(table, mean, std, ends) result(this)
      type(normal_table_t), intent(in) :: table
      real(wp), intent(in) :: mean, std, ends(2)  !! any unit
      integer(i8) :: first, beyond

      this%mean = mean
      this%std = std
      if (std <= 0) return
      first = first_word(table, (ends(1) - mean)/std, .true.)
      beyond = first_word(table, (ends(2) - mean)/std, .false.)
      this%first = real(first, wp)
      this%words = real(beyond - first, wp)
   end function scatter

   !> First word whose normal deviate is above a limit, or equal to it if `inclusive`; one past the last word if none.
   pure integer(i8) function first_word(table, limit, inclusive) result(high)
      type(normal_table_t), intent(in) :: table
      real(wp), intent(in) :: limit  !! [-]
      logical, intent(in) :: inclusive
      integer(i8) :: low, middle
      real(wp) :: normal_value

      low = 0
      high = 2_i8**32
      do while (low < high)
         middle = (low + high)/2
         normal_value = normal(table, middle)
         if (normal_value > limit .or. (inclusive .and. normal_value >= limit)) then
            high = middle
         else
            low = middle + 1
         end if
      end do
   end function first_word

   !> Value of the variable for a random word.
   pure real(wp) function drawn_coefficient(this, table, word)
      type(scatter_t), intent(in) :: this
      type(normal_table_t), intent(in) :: table
      integer(i8), intent(in) :: word  !! 0..2**32-1

      drawn_coefficient = this%mean
      if (this%words > 0) drawn_coefficient = this%mean + this%std &
                                               *normal(table, int(this%first + uniform(word)*this%words, i8))
   end function drawn_coefficient

   !> Return whether a boulder stays where it lands, because of the model or the obstacle height.
   pure logical function absorbs(this, obstacle)
      type(classical_t), intent(in) :: this
      real(wp), intent(in) :: obstacle  !! [m]

      absorbs = this%model == absorbing .or. (this%model == rockyfor3d .and. obstacle >= absorbing_obstacle)
   end function absorbs

   !> Compute one rebound. The ground is tilted against the direction of motion by a random angle (Pfeiffer and Bowen
   !> 1989; here uniform). Otherwise a rebound from a plane would never convert tangential into normal velocity, and
   !> hops on any slope would shrink to zero within a finite distance. A rebound that gains energy, or does not rise, is
   !> limited as in rockfall_impact.
   !>
   !> Between rebounds, W is that of a sphere with equal rotational energy; within this procedure, the boulder rotates
   !> with its own inertia.
   pure subroutine classical_rebound(this, table, words, tilt, boulder, inertia, obstacle, v_in, out)
      type(classical_t), intent(in) :: this
      type(normal_table_t), intent(in) :: table
      integer(i8), intent(in) :: words(rebound_words)
      real(wp), intent(in) :: tilt      !! tilt of the ground, divided by `roughness`, 0 to 1 [-]
      type(boulder_t), intent(in) :: boulder
      real(wp), intent(in) :: inertia   !! I/(m R**2) [-]
      real(wp), intent(in) :: obstacle  !! obstacle height [m]
      real(wp), intent(in) :: v_in(3)   !! V_t, V_n, W [m/s]
      type(rebound_t), intent(out) :: out
      real(wp) :: s, c, side, spin, v_tilted(3)

      call sine_cosine(this%roughness*tilt, s, c)
      v_tilted = tilted(v_in, s, c)
      side = sign(1.0_wp, v_tilted(1))  !! on tilted ground the boulder may land moving backwards
      spin = sqrt(inertia_factor/inertia)  ! R omega over W
      v_tilted = model_rebound(this, table, words, boulder, inertia, obstacle, v_tilted*[side, 1.0_wp, side*spin])
      out%v = tilted(v_tilted*[side, 1.0_wp, side/spin], -s, c)
      out%forced = .not. is_admissible(v_in, out%v)
      if (out%forced) call limit_rebound(out%v, v_in)
   end subroutine classical_rebound

   !> Make a rolling boulder hop from obstacle to obstacle, `min_hop` radii apart (Pfeiffer and Bowen 1989 displace it
   !> by that length). If its energy suffices, part of it lifts the boulder: a hop over even ground has the length 2 V_t
   !> V_n/pull, apart from the acceleration along the slope.
   pure subroutine lengthen_hop(this, boulder, pull, v)
      type(classical_t), intent(in) :: this
      type(boulder_t), intent(in) :: boulder
      real(wp), intent(in) :: pull     !! gravity along the normal of the ground [m/s2]
      real(wp), intent(inout) :: v(3)  !! V_t, V_n, W after a rebound [m/s]
      real(wp) :: speed2, required, normal2

      required = pull*this%min_hop*boulder%radius
      speed2 = v(1)*v(1) + v(2)*v(2)
      if (required <= 0 .or. speed2 <= required) return
      normal2 = required*required/(2*(speed2 + sqrt((speed2 - required)*(speed2 + required))))  ! smaller root
      if (v(2)*v(2) >= normal2) return
      v(1) = sign(sqrt(speed2 - normal2), v(1))
      v(2) = sqrt(normal2)
   end subroutine lengthen_hop

   !> Components V_t, V_n, W relative to ground tilted against the motion by an angle with this sine and cosine.
   pure function tilted(v, s, c)
      real(wp), intent(in) :: v(3)  !! [m/s]
      real(wp), intent(in) :: s, c  !! [-]
      real(wp) :: tilted(3)

      tilted = v
      if (abs(s) > 0) tilted(:2) = [c*v(1) + s*v(2), c*v(2) - s*v(1)]
   end function tilted

   !> Compute V_t, V_n, W after an impact by the selected model, from parameters already drawn.
   pure function model_rebound(this, table, words, boulder, inertia, obstacle, v_in) result(v)
      type(classical_t), intent(in) :: this
      type(normal_table_t), intent(in) :: table
      integer(i8), intent(in) :: words(rebound_words)
      type(boulder_t), intent(in) :: boulder
      real(wp), intent(in) :: inertia   !! I/(m R**2) [-]
      real(wp), intent(in) :: obstacle  !! [m]
      real(wp), intent(in) :: v_in(3)   !! V_t, V_n, W [m/s]
      real(wp) :: v(3)
      real(wp) :: normal_drawn, tangential_drawn, height

      normal_drawn = drawn_coefficient(this%normal, table, words(normal_restitution_word))
      tangential_drawn = drawn_coefficient(this%tangential, table, words(tangential_restitution_word))
      select case (this%model)
      case (rockyfor3d)
         height = obstacle*(1 + this%obstacle_spread*(2*uniform(words(obstacle_spread_word)) - 1))
         v = obstacle_rebound(boulder, inertia, height, this%soil_density, normal_drawn, v_in)
      case (pfeiffer_bowen)
         v = friction_rebound(normal_drawn, tangential_drawn, inertia, v_in)
      case (bourrier_hungr)
         v = sliding_rebound(normal_drawn, tangential_drawn, this%friction, inertia, v_in)
      case default
         v = [tangential_drawn, -normal_drawn, tangential_drawn]*v_in
      end select
   end function model_rebound

   !> Rebound of Rockyfor3D (Dorren 2016): the obstacle height MOH and the penetration D_p slow a boulder of radius R
   !> along the ground, R_t = 1/(1 + (MOH + D_p)/R).
   pure function obstacle_rebound(boulder, inertia, height, soil_density, r_n, v_in) result(v)
      type(boulder_t), intent(in) :: boulder
      real(wp), intent(in) :: inertia       !! I/(m R**2) [-]
      real(wp), intent(in) :: height        !! MOH [m]
      real(wp), intent(in) :: soil_density  !! [kg/m3]
      real(wp), intent(in) :: r_n           !! [-]
      real(wp), intent(in) :: v_in(3)       !! V_t, V_n, W [m/s]
      real(wp) :: v(3)
      real(wp) :: depth

      depth = penetration(boulder, soil_density, r_n, v_in(1)*v_in(1) + v_in(2)*v_in(2))
      v = rolling_velocity(1/(1 + (height + depth)/boulder%radius), inertia, v_in)
      v(2) = slowed_normal(r_n, v_in(2))
   end function obstacle_rebound

   !> Penetration D_p [m] of a boulder of diameter d and mass m into soil (Pichler et al. 2005), at most its radius:
   !> I = m V**2/(R_soil d**3), N = m/(rho_soil B d**3) without the corrections for blunt cones, and R_soil =
   !> 55e9 R_n**7 Pa as in Rockyfor3D. V is the total speed. The formula for depths over 0.707 d is not needed.
   pure real(wp) function penetration(boulder, soil_density, r_n, speed2) result(depth)
      type(boulder_t), intent(in) :: boulder
      real(wp), intent(in) :: soil_density  !! [kg/m3]
      real(wp), intent(in) :: r_n           !! [-]
      real(wp), intent(in) :: speed2        !! V**2 [m2/s2]
      real(wp) :: diameter, r_n2, resistance, packed, impact, mass, eased

      diameter = 2*boulder%radius
      r_n2 = r_n*r_n
      resistance = indentation_resistance*(r_n2*r_n2*r_n2*r_n)
      packed = boulder%mass/(diameter*diameter*diameter)
      impact = packed*speed2/resistance
      mass = packed/(soil_density*compressibility)
      eased = (1 + nose*pi/(4*mass))/(1 + impact/mass)
      depth = sqrt(eased*(4*nose/pi)*impact)
      depth = min(depth*diameter, boulder%radius)
   end function penetration

   !> Rebound of Pfeiffer and Bowen (1989): tangential energy is scaled for sliding speed and for impact speed,
   !> F_f = R_t + (1 - R_t)/(((V_t - W)/20 ft/s)**2 + 1.2), S_F = R_t/((V_n/(250 ft/s R_n))**2 + 1).
   pure function friction_rebound(r_n, r_t, inertia, v_in) result(v)
      real(wp), intent(in) :: r_n, r_t  !! [-]
      real(wp), intent(in) :: inertia   !! I/(m R**2) [-]
      real(wp), intent(in) :: v_in(3)   !! V_t, V_n, W [m/s]
      real(wp) :: v(3)
      real(wp) :: slip, speed_ratio

      slip = (v_in(1) - v_in(3))/friction_speed
      speed_ratio = v_in(2)/(scaling_speed*r_n)
      v = rolling_velocity((r_t + (1 - r_t)/(slip*slip + friction_offset))*(r_t/(speed_ratio*speed_ratio + 1)), &
                           inertia, v_in)
      v(2) = slowed_normal(r_n, v_in(2))
   end function friction_rebound

   !> Velocity of a boulder that leaves the ground rolling, with a fraction f of its tangential energy: V_t' =
   !> sqrt(R**2 (I omega**2 + m V_t**2) f/(I + m R**2)), W' = V_t' (Pfeiffer and Bowen 1989).
   pure function rolling_velocity(energy_fraction, inertia, v_in) result(v)
      real(wp), intent(in) :: energy_fraction  !! [-]
      real(wp), intent(in) :: inertia  !! I/(m R**2) [-]
      real(wp), intent(in) :: v_in(3)  !! V_t, V_n, W [m/s]
      real(wp) :: v(3)

      v = sqrt((v_in(1)*v_in(1) + inertia*v_in(3)*v_in(3))*energy_fraction/(1 + inertia))
   end function rolling_velocity

   !> Normal velocity V_n' = -V_n R_n/(1 + (V_n/30 ft/s)**2) (Pfeiffer and Bowen 1989): hard impacts crush the ground.
   pure real(wp) function slowed_normal(r_n, v_n)
      real(wp), intent(in) :: r_n  !! [-]
      real(wp), intent(in) :: v_n  !! <= 0 [m/s]

      slowed_normal = -v_n*r_n/(1 + (v_n/normal_speed)*(v_n/normal_speed))
   end function slowed_normal

   !> Rebound of Bourrier and Hungr (2011): R_n = v_half/(|V_n| + v_half). If friction suffices, |R_t (V_t - W)| 2/7 (of
   !> a sphere) < tan(phi) (1 + R_n) |V_n|, the contact point sticks and the boulder rolls; else it slides, and friction
   !> slows V_t and spins the boulder up. The velocity after the impact is continuous between the two cases.
   pure function sliding_rebound(v_half, r_t, friction, inertia, v_in) result(v)
      real(wp), intent(in) :: v_half    !! [m/s]
      real(wp), intent(in) :: r_t       !! [-]
      real(wp), intent(in) :: friction  !! tan(phi) [-]
      real(wp), intent(in) :: inertia   !! I/(m R**2) [-]
      real(wp), intent(in) :: v_in(3)   !! V_t, V_n, W [m/s]
      real(wp) :: v(3)
      real(wp) :: r_n, push, slip, stick

      r_n = v_half/(v_half - v_in(2))
      slip = r_t*(v_in(1) - v_in(3))
      stick = slip*inertia/(1 + inertia)  ! impulse that stops the sliding: 2/7 of the slip for a sphere
      push = friction*(1 + r_n)*(-v_in(2))
      push = sign(min(push, abs(stick)), slip)
      v = [r_t*v_in(1) - push, -r_n*v_in(2), r_t*v_in(3) + push/inertia]
   end function sliding_rebound
end module rockfall_classical_rebound
