! SPDX-License-Identifier: BSD-3-Clause
!> CPU time of the parts of a rebound [ns], each alone in a loop, on rough ground at 38 degrees. A part runs faster
!> alone than among the others, so their sum is below the time of a rebound.
program parts
   use rockfall_kinds, only: wp, i8
   use rockfall_error, only: error_t
   use rockfall_random, only: random_key_t, random_key, normal_table_t, normal_table, normal, random_words, for_impact
   use rockfall_terrain, only: terrain_t, terrain, patch_t, locate, cell_descent, gradient
   use rockfall_flight, only: flight_t, landing_t, span_t, fly, launch_rate, arc_length
   use rockfall_impact, only: impact_set_t, impact_set, rebound_t, rebound
   use rockfall_direction, only: turning_t, past_aspect, new_heading
   use rockfall_maps, only: visits_t, start_visits, visit_path
   implicit none
   integer, parameter :: times = 1000000, nx = 400
   real(wp), parameter :: cell = 2.5_wp
   real(wp), allocatable, target :: z(:, :)
   type(random_key_t) :: key
   type(normal_table_t) :: table
   type(impact_set_t) :: set
   type(terrain_t) :: dem
   real(wp) :: start, total
   integer :: k

   key = random_key(1_i8)
   table = normal_table()
   call make_ground()
   call make_set()
   total = 0
   call time_words()
   call time_normals()
   call time_rebound()
   call time_direction()
   call time_flight()
   call time_arc()
   call time_visits()
   if (total > huge(total)) print *, total  ! prevents the removal of loops

contains

   subroutine tell(name)
      character(len=*), intent(in) :: name
      real(wp) :: now

      call cpu_time(now)
      print "(a,t46,f8.1,a)", name, (now - start)/times*1.0e9_wp, " ns"
   end subroutine tell

   subroutine make_ground()
      integer :: i, j
      integer(i8) :: word(4)

      allocate (z(nx, nx))
      do j = 1, nx
         do i = 1, nx
            word = random_words(key, 7_i8, int(i, i8), int(j, i8), 0_i8)
            z(i, j) = 2000 - 0.78_wp*cell*j + 0.3_wp*normal(table, word(1))
         end do
      end do
      dem = terrain(0.0_wp, nx*cell, cell, z8=z)
   end subroutine make_ground

   subroutine make_set()
      real(wp) :: c(9, 9)
      type(error_t), allocatable :: error
      integer :: i

      c = 0
      do i = 1, 9
         c(i, i) = 0.003_wp
      end do
      call impact_set([0.62_wp, 0.0_wp, 0.13_wp, 0.19_wp, -0.41_wp, -0.19_wp, 0.24_wp, 0.0_wp, 0.34_wp], c, set, error)
   end subroutine make_set

   subroutine time_words()
      integer(i8) :: word(4)

      call cpu_time(start)
      do k = 1, times
         word = random_words(key, for_impact, int(k, i8), 1_i8, 0_i8)
         total = total + word(4)
      end do
      call tell("random words (a Philox block)")
   end subroutine time_words

   subroutine time_normals()
      integer(i8) :: word(3)
      real(wp) :: n(3)

      word = 1
      call cpu_time(start)
      do k = 1, times
         word = iand(word*69069 + 1, int(z"FFFFFFFF", i8))
         n = normal(table, word)
         total = total + sum(n)
      end do
      call tell("three normal numbers from words")
   end subroutine time_normals

   subroutine time_rebound()
      integer(i8) :: word(3)
      type(rebound_t) :: out

      word = [(k*400000000_i8, k=1, 3)]
      call cpu_time(start)
      do k = 1, times
         word = iand(word*69069 + 1, int(z"FFFFFFFF", i8))
         call rebound(set, table, key, 1_i8, int(k, i8), word, [10.0_wp, -4.0_wp, 5.0_wp], out)
         total = total + out%v(1)
      end do
      call tell("covariance of V_out, normals, admissible")
   end subroutine time_rebound

   subroutine time_direction()
      real(wp) :: descent(2), heading(2)
      logical :: pit

      heading = [0.6_wp, -0.8_wp]
      call cpu_time(start)
      do k = 1, times
         call cell_descent(dem, [2 + mod(k*7, nx - 3), 2 + mod(k*13, nx - 3)], [0.0_wp, -0.78_wp], descent, pit)
         heading = new_heading(turning_t(past_aspect, mod(k*0.37_wp, 1.0_wp)), heading, [0.0_wp, 0.0_wp], &
                               descent, pit)
         total = total + heading(1)
      end do
      call tell("aspect of the cell, new heading")
   end subroutine time_direction

   subroutine time_flight()
      type(flight_t) :: flight
      type(landing_t) :: landing

      call cpu_time(start)
      do k = 1, times
         call launch(flight)
         call fly(dem, 9.81_wp, flight, landing)
         total = total + landing%x
      end do
      call tell("flight of 0.7 s at 12 m/s, patch by patch")
   end subroutine time_flight

   subroutine launch(flight)
      type(flight_t), intent(out) :: flight
      real(wp) :: u, w

      flight%x = 100 + mod(k*0.61_wp, 700.0_wp)
      flight%y = 300 + mod(k*0.37_wp, 600.0_wp)
      call locate(dem, flight%x, flight%y, flight%patch, u, w)
      flight%z = flight%patch%z00 + flight%patch%a*u + flight%patch%b*w + flight%patch%c*u*w
      flight%v = [2.0_wp, -9.0_wp, -4.0_wp]
      flight%v(3) = 3 + dot_product(gradient(dem, flight%patch, u, w), flight%v(1:2))
      flight%rate = launch_rate(dem, flight%patch, u, w, flight%v)
   end subroutine launch

   subroutine time_arc()
      call cpu_time(start)
      do k = 1, times
         total = total + arc_length([2.0_wp, -9.0_wp, mod(k*0.1_wp, 4.0_wp)], 9.81_wp, 0.7_wp)
      end do
      call tell("length of its way")
   end subroutine time_arc

   subroutine time_visits()
      type(flight_t) :: flight
      type(landing_t) :: landing
      type(span_t) :: spans(2*nx)
      type(visits_t) :: visits
      integer :: n

      call cpu_time(start)
      do k = 1, times
         if (mod(k, 90) == 1) call start_visits(visits)
         call launch(flight)
         call fly(dem, 9.81_wp, flight, landing, spans, n)
         call visit_path(visits, dem, 9.81_wp, flight, landing%time, 1.0_wp, spans(:n))
         total = total + visits%n
      end do
      call tell("the flight with the cells under it")
   end subroutine time_visits
end program parts
