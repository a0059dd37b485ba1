! SPDX-License-Identifier: BSD-3-Clause
!> Objects that a boulder hits: cells and energies equal those from a fine sampling of its path.
program test_hit_maps
   use rockfall_kinds, only: wp, i4
   use rockfall_terrain, only: terrain_t, terrain
   use rockfall_flight, only: flight_t
   use rockfall_maps, only: maps_t, visits_t, needs_visits
   use rockfall_hit_maps, only: path_t, paths_t, needs_hits, find_hits, add_hits
   use check_m, only: check, finish
   implicit none

   integer, parameter :: nx = 30, ny = 20
   real(wp), parameter :: gravity = 9.81_wp, cell = 2.0_wp
   real(wp), target :: z(nx, ny)
   integer(i4), target :: hits(nx, ny), exceeded(nx, ny, 2)
   type(terrain_t) :: dem
   type(maps_t) :: maps

   call random_init(.true., .false.)
   z = 0
   dem = terrain(0.0_wp, 0.0_wp, cell, z8=z)
   maps%hits => hits
   call test_sampled()
   call test_at_rest()
   call test_counts()
   call finish()

contains

   !> Random flights, also along an axis and beyond the raster. Cells within one sampling step of the edge of the reach
   !> are not tested.
   subroutine test_sampled()
      type(flight_t) :: flight
      type(visits_t) :: found
      integer, parameter :: samples = 4000
      real(wp) :: draw(7), distance, time, t, spin, near(nx, ny), top(nx, ny), got(nx, ny), step, steepest
      integer :: turn, k, i, j

      spin = 3
      do turn = 1, 200
         call random_number(draw)
         flight%x = (nx + 4)*cell*draw(1) - 3*cell
         flight%y = (ny + 4)*cell*draw(2) - 3*cell
         flight%v = [30*draw(3) - 15, 30*draw(4) - 15, 20*draw(5) - 5]
         if (mod(turn, 5) == 0) flight%v(mod(turn, 2) + 1) = 0
         time = 2*draw(6)**4
         distance = 0.2_wp + 8*draw(7)
         call find_hits(found, dem, paths_t(1, [path_t(flight%x, flight%y, flight%v, gravity, time, spin)]), distance)
         near = huge(near)
         top = 0
         do k = 0, samples
            t = time*k/samples
            do j = 1, ny
               do i = 1, nx
                  associate (away => norm2([flight%x + flight%v(1)*t - (i - 1)*cell, &
                                            flight%y + flight%v(2)*t - (j - 1)*cell]))
                     near(i, j) = min(near(i, j), away)
                     if (away <= distance) &
                        top(i, j) = max(top(i, j), sum(flight%v(:2)**2) + (flight%v(3) - gravity*t)**2)
                  end associate
               end do
            end do
         end do
         got = 0
         do k = 1, found%n
            associate (at => found%visit(k))
               got(at%cell(1), ny + 1 - at%cell(2)) = at%max(2) - spin
            end associate
         end do
         step = norm2(flight%v(:2))*time/samples
         steepest = 2*(abs(flight%v(3)) + gravity*time)*gravity
         call check("near cells are hit", all(got > 0 .or. near > distance - step))
         call check("others are not", all(.not. got > 0 .or. near <= distance + step))
         call check("with the maximum speed while near", &
                    all(.not. got > 0 .or. .not. top > 0 &
                        .or. abs(got - top) <= steepest*grazing(near, distance, norm2(flight%v(:2)), time)))
      end do
   end subroutine test_sampled

   !> Bound of the error of a sampled time of entering or leaving a disc [s]; large if the path only grazes it.
   elemental real(wp) function grazing(near, distance, speed, time)
      real(wp), intent(in) :: near, distance, speed, time
      real(wp) :: half_chord

      half_chord = sqrt(max(0.0_wp, distance**2 - near**2))
      grazing = time/1000 + 1.0e-9_wp
      if (half_chord < 0.1_wp*distance) grazing = grazing + 2*half_chord/max(speed, 1.0e-9_wp)
   end function grazing

   !> A boulder that does not move in plan hits the objects within its reach.
   subroutine test_at_rest()
      type(flight_t) :: flight
      type(visits_t) :: found

      flight%x = 10
      flight%y = 10
      flight%v = [0.0_wp, 0.0_wp, -4.0_wp]
      call find_hits(found, dem, paths_t(1, [path_t(flight%x, flight%y, flight%v, gravity, 0.0_wp, 0.0_wp)]), 2.0_wp)
      call check("a node and its neighbours", found%n == 5)
      call check("at its speed", all(abs(found%visit(:5)%max(2) - 16) < 1.0e-12_wp))
   end subroutine test_at_rest

   !> A boulder counts once, and for each threshold below its energy.
   subroutine test_counts()
      type(flight_t) :: flight
      type(visits_t) :: found
      type(path_t) :: path
      type(paths_t) :: twice

      maps%threshold = [0.0_wp, 100.0_wp]
      maps%hits_exceeded => exceeded
      call check("hits are hits", needs_hits(maps) .and. needs_visits(maps))
      hits = 0
      exceeded = 0
      flight%x = 20
      flight%y = 20
      flight%v = [10.0_wp, 0.0_wp, 0.0_wp]
      path = path_t(flight%x, flight%y, flight%v, 0.0_wp, 1.0_wp, 0.0_wp)
      twice = paths_t(2, [path, path])
      twice%path(2)%time = 0.5_wp
      call find_hits(found, dem, twice, 1.0_wp)
      call add_hits(maps, found, 1.0_wp)  ! energy 50 J
      call add_hits(maps, found, 3.0_wp)  ! energy 150 J
      call check("cells along ten metres", count(hits == 2) == 6 .and. all(hits == 0 .or. hits == 2))
      call check("all move", all(exceeded(:, :, 1) == hits))
      call check("one is heavy", all(2*exceeded(:, :, 2) == hits))
   end subroutine test_counts
end program test_hit_maps
