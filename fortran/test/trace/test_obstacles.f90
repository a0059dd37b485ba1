! SPDX-License-Identifier: BSD-3-Clause
!> Barriers and trees on a flight over flat ground: which is hit first, what it absorbs, and how the boulder flies on.
program test_obstacles
   use rockfall_kinds, only: wp, i1, i8
   use rockfall_random, only: random_key
   use rockfall_terrain, only: terrain, locate
   use rockfall_boulder, only: kinetic_energy
   use rockfall_flight, only: flight_t, landing_t, span_t, fly, end_flight
   use rockfall_line, only: line
   use rockfall_barrier, only: barrier_t, stopped_there, broken_through, passed_over
   use rockfall_forest, only: tree_model_t, build_forest, absorbed_fraction, max_stem_energy
   use rockfall_scene_type, only: scene_t
   use rockfall_outcome, only: boulder_result_t, stopped_by_barrier
   use rockfall_scratch, only: scratch_t, clear_scratch, with_all
   use rockfall_crossings, only: start_crossings, outcome_at
   use rockfall_obstacles, only: obstacle_t, find_obstacle, hit_obstacle, record_passed_over, none
   use check_m, only: check, check_close, finish
   implicit none

   integer, parameter :: n = 50
   real(wp), parameter :: cell = 2.0_wp, gravity = 9.81_wp, radius = 0.5_wp, mass = 1000, near = 1.0e-9_wp
   real(wp), target :: z(n, n)
   type(scene_t) :: scene
   type(boulder_result_t) :: result
   type(scratch_t) :: scratch
   type(flight_t) :: flight
   type(landing_t) :: landing
   type(obstacle_t) :: obstacle
   real(wp) :: v(3), w

   z = 0
   scene%dem = terrain(0.0_wp, 0.0_wp, cell, z8=z)
   scene%gravity = gravity
   scene%key = random_key(7_i8)
   scene%lines = [line([40.0_wp, 40.0_wp], [1.0_wp, 90.0_wp])]
   scene%barriers = [barrier_t(1, 3.0_wp, 1.0e5_wp)]
   allocate (scratch%crossings)
   call start_crossings(1, scratch%crossings)
   call test_break_through()
   call test_stop()
   call test_pass_over()
   call test_tree()
   call test_nearer_first()
   call finish()

contains

   !> Level shot eastward at 20 m/s from a height above the ground, up to the first obstacle.
   subroutine shoot(above)
      real(wp), intent(in) :: above
      type(span_t) :: spans(2*n)
      real(wp) :: at(2)
      integer :: n_spans

      call clear_scratch(scene, with_all, scratch)
      result = boulder_result_t()
      result%boulder%radius = radius
      result%boulder%mass = mass
      flight = flight_t(x=30.0_wp, y=50.5_wp, z=above, v=[20.0_wp, 0.0_wp, 0.0_wp], above=above, rate=0.0_wp, &
                        heading=[1.0_wp, 0.0_wp])
      call locate(scene%dem, flight%x, flight%y, flight%patch, at(1), at(2))
      call fly(scene%dem, gravity, flight, landing, spans, n_spans)
      w = 0
      call find_obstacle(scene, gravity, result, flight, landing, w, spans(:n_spans), scratch, obstacle)
      v = flight%v
      if (obstacle%kind == none) return
      call end_flight(scene%dem, gravity, flight, obstacle%time, spans, n_spans, landing)
      v(3) = v(3) - gravity*landing%time
   end subroutine shoot

   !> Kinetic energy of the boulder after the hit.
   real(wp) function energy_of(v)
      real(wp), intent(in) :: v(3)

      energy_of = sum(kinetic_energy(result%boulder, v, w/radius))
   end function energy_of

   !> The boulder reaches the barrier after half a second; the barrier absorbs 100 of 212 kJ.
   subroutine test_break_through()
      real(wp) :: before

      call shoot(2.0_wp)
      call check_close("met after 10 m", obstacle%time, 0.5_wp, near)
      call check("and crossed", scratch%crossings%n == 1)
      before = energy_of(v)
      call hit_obstacle(scene, 1_i8, obstacle, landing, v, w, result, flight, scratch)
      call check_close("energy that is left", energy_of(flight%v), before - 1.0e5_wp, near)
      call check_close("energy that was taken", result%energy%barriers, 1.0e5_wp, near)
      call check("the direction stays", abs(flight%v(1)*v(3) - flight%v(3)*v(1)) <= near)
      call check("it flies on", result%status == 0)
      call check("broken through", outcome_at(scratch%crossings, 1) == int(broken_through, i1))
      call check("from a place in front of it", flight%x < 40 .and. flight%x > 40 - 1.0e-6_wp)
   end subroutine test_break_through

   subroutine test_stop()
      real(wp) :: before

      scene%barriers%capacity = 1.0e6_wp
      call shoot(2.0_wp)
      before = energy_of(v)
      call hit_obstacle(scene, 1_i8, obstacle, landing, v, w, result, flight, scratch)
      call check("stopped", result%status == stopped_by_barrier)
      call check("so the barrier says", outcome_at(scratch%crossings, 1) == int(stopped_there, i1))
      call check_close("it takes all", result%energy%barriers, before, near)
      scene%barriers%capacity = 1.0e5_wp
   end subroutine test_stop

   !> In half a second the boulder falls by 1.23 m: from 5 m it passes over the edge at 3 m.
   subroutine test_pass_over()
      call shoot(5.0_wp)
      call check("no obstacle", obstacle%kind == none)
      call check("but a crossing", scratch%crossings%n == 1 .and. outcome_at(scratch%crossings, 1) == 0)
      call record_passed_over(scene, result, scratch%crossings)
      call check("passed over", outcome_at(scratch%crossings, 1) == int(passed_over, i1))
   end subroutine test_pass_over

   !> A stem of 40 cm in the path, 5 m away: hit centrally when the boulder touches it, and broken.
   subroutine test_tree()
      real(wp), parameter :: dbh = 40.0_wp
      real(wp) :: before, taken

      allocate (scene%forest)
      call build_forest([35.0_wp], [50.5_wp], [0.0_wp, 0.0_wp], [dbh], [1.0_wp], tree_model_t(), scene%forest)
      call shoot(2.0_wp)
      call check_close("when the discs touch", obstacle%time, (5 - radius - 0.2_wp)/20, near)
      before = energy_of(v)
      taken = min(before, absorbed_fraction(0.0_wp)*max_stem_energy(dbh))
      call hit_obstacle(scene, 1_i8, obstacle, landing, v, w, result, flight, scratch)
      call check_close("energy that the stem takes", result%energy%trees, taken, near)
      call check_close("energy that is left", energy_of(flight%v), before - taken, 1.0e-6_wp)
      call check("one tree hit", result%trees_hit == 1)
      call check("broken where the boulder flies on", size(scratch%felled) == merge(1, 0, taken < before))
   end subroutine test_tree

   !> Of a tree and a barrier, the nearer is hit.
   subroutine test_nearer_first()
      call shoot(2.0_wp)
      call check("the tree in front of the barrier", obstacle%hit%tree == 1)
      call check("the line is not reached", scratch%crossings%n == 0)
      call build_forest([45.0_wp], [50.5_wp], [0.0_wp, 0.0_wp], [40.0_wp], [1.0_wp], tree_model_t(), scene%forest)
      call shoot(2.0_wp)
      call check("the barrier in front of the tree", obstacle%number == 1 .and. obstacle%hit%tree == 0)
   end subroutine test_nearer_first
end program test_obstacles
