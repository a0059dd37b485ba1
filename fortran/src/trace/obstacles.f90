! SPDX-License-Identifier: BSD-3-Clause
!> Trees and barriers: the first obstacle that a boulder hits, and the effect of the hit.
module rockfall_obstacles
   use rockfall_kinds, only: wp, i1, i8
   use rockfall_math, only: squared_length
   use rockfall_random, only: random_words, for_tree
   use rockfall_terrain, only: cell_of
   use rockfall_boulder, only: kinetic_energy
   use rockfall_flight, only: flight_t, landing_t, span_t, flight_from, no_hit_time
   use rockfall_direction, only: rotated
   use rockfall_line, only: next_crossing
   use rockfall_barrier, only: barrier_t, barrier_outcome, point_in_front, stopped_there, broken_through, passed_over
   use rockfall_forest, only: forest_t, tree_hit_t, tree_impact_t, find_first_hit, tree_impact
   use rockfall_tree_maps, only: add_tree_hit
   use rockfall_scene_type, only: scene_t, is_slow
   use rockfall_outcome, only: boulder_result_t, stopped_by_tree, stopped_by_barrier, impact_limit
   use rockfall_crossings, only: crossing_t, crossings_t, crossing, record_crossings, outcome_at, find_entry
   use rockfall_record, only: vertex_t, record_vertex
   use rockfall_scratch, only: scratch_t
   implicit none
   private
   public :: obstacle_t, find_obstacle, hit_obstacle, record_passed_over, none

   !> Kinds of obstacles that can end a flight before it reaches the ground.
   integer, parameter :: none = 0, barrier = 1, tree = 2

   !> End of a flight in the air.
   type :: obstacle_t
      integer :: kind = none        !! none, barrier or tree
      integer :: number = 0         !! index of the barrier, if it is one
      real(wp) :: time = no_hit_time  !! time since the start of the flight [s]
      type(tree_hit_t) :: hit = tree_hit_t()
   end type obstacle_t

contains

   !> Find the first obstacle on a path, and record the line crossings up to it.
   pure subroutine find_obstacle(scene, gravity, result, flight, landing, omega_r, spans, scratch, obstacle)
      type(scene_t), intent(in) :: scene
      real(wp), intent(in) :: gravity  !! gravity along the path [m/s2]
      type(boulder_result_t), intent(in) :: result
      type(flight_t), intent(in) :: flight
      type(landing_t), intent(in) :: landing
      real(wp), intent(in) :: omega_r  !! W [m/s]
      type(span_t), intent(in), contiguous :: spans(:)
      type(scratch_t), intent(inout) :: scratch
      type(obstacle_t), intent(out) :: obstacle

      if (allocated(scene%barriers)) &
         call find_barrier(scene, gravity, result, flight, landing, omega_r, scratch%crossings, obstacle)
      if (allocated(scene%forest)) &
         call find_tree(scene%forest, result%boulder%radius, flight, spans, scratch%felled, obstacle)
      if (allocated(scene%lines)) &
         call record_crossings(scene, gravity, result, flight, landing, omega_r, scratch%crossings, obstacle%time)
      if (obstacle%kind == barrier) &
         call record_hit(scene%barriers(obstacle%number)%line, scratch%crossings, &
                         crossing(scene, gravity, result, flight, obstacle%time, omega_r))
   end subroutine find_obstacle

   !> Record the crossing at which a barrier is hit, replacing crossings at which the boulder passed over: the hit loads
   !> the barrier.
   pure subroutine record_hit(line, crossings, hit)
      integer, intent(in) :: line  !! index of the line
      type(crossings_t), intent(inout) :: crossings
      type(crossing_t), intent(in) :: hit
      integer :: k

      call find_entry(crossings, line, k)
      crossings%at(k) = hit
      crossings%at(k)%line = line
   end subroutine record_hit

   !> Find the first barrier hit by a flight, unless `obstacle` is hit earlier.
   pure subroutine find_barrier(scene, gravity, result, flight, landing, omega_r, crossings, obstacle)
      type(scene_t), intent(in) :: scene
      real(wp), intent(in) :: gravity    !! gravity along the path [m/s2]
      type(boulder_result_t), intent(in) :: result
      type(flight_t), intent(in) :: flight
      type(landing_t), intent(in) :: landing
      real(wp), intent(in) :: omega_r    !! W [m/s]
      type(crossings_t), intent(in) :: crossings
      type(obstacle_t), intent(inout) :: obstacle
      real(wp) :: fraction, time
      integer :: k

      do k = 1, size(scene%barriers)
         if (outcome_at(crossings, scene%barriers(k)%line) == broken_through) cycle
         fraction = -1
         do  ! a polyline may be crossed several times
            fraction = next_crossing(scene%lines(scene%barriers(k)%line), [flight%x, flight%y], &
                                     [landing%x, landing%y], fraction)
            time = fraction*landing%time
            if (fraction > 1 .or. time >= obstacle%time) exit
            if (hits_barrier(scene%barriers(k), result, crossing(scene, gravity, result, flight, time, omega_r))) then
               obstacle = obstacle_t(barrier, k, time)
               exit
            end if
         end do
      end do
   end subroutine find_barrier

   !> Return whether a boulder crosses a barrier below its top edge.
   pure logical function hits_barrier(this, result, crossing)
      type(barrier_t), intent(in) :: this
      type(boulder_result_t), intent(in) :: result
      type(crossing_t), intent(in) :: crossing

      hits_barrier = passed_over /= barrier_outcome(this%height, this%capacity, crossing%passing_height, &
                                                    sum(kinetic_energy(result%boulder, crossing%v, crossing%omega)))
   end function hits_barrier

   !> Record `passed_over` for barriers that a boulder crossed but never hit.
   pure subroutine record_passed_over(scene, result, crossings)
      type(scene_t), intent(in) :: scene
      type(boulder_result_t), intent(in) :: result
      type(crossings_t), intent(inout) :: crossings
      integer :: k

      do k = 1, size(scene%barriers)
         if (crossings%place(scene%barriers(k)%line) == 0) cycle
         associate (at => crossings%at(crossings%place(scene%barriers(k)%line)))
            if (.not. at%crossed .or. at%outcome /= 0) cycle
            if (.not. hits_barrier(scene%barriers(k), result, at)) at%outcome = passed_over
         end associate
      end do
   end subroutine record_passed_over

   !> Find the first tree hit by a flight, unless `obstacle` is hit earlier.
   pure subroutine find_tree(forest, radius, flight, spans, felled, obstacle)
      type(forest_t), intent(in) :: forest
      real(wp), intent(in) :: radius  !! R_b [m]
      type(flight_t), intent(in) :: flight
      type(span_t), intent(in), contiguous :: spans(:)
      integer, intent(in) :: felled(:)
      type(obstacle_t), intent(inout) :: obstacle
      type(tree_hit_t) :: hit

      call find_first_hit(forest, spans, flight%x, flight%y, flight%v(1:2), radius, felled, hit)
      if (hit%tree > 0 .and. hit%time < obstacle%time) obstacle = obstacle_t(tree, 0, hit%time, hit)
   end subroutine find_tree

   !> Apply the energy loss at an obstacle; the boulder flies on with the remaining energy.
   pure subroutine hit_obstacle(scene, number, obstacle, landing, v, omega_r, result, flight, scratch)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: number
      type(obstacle_t), intent(in) :: obstacle
      type(landing_t), intent(in) :: landing
      real(wp), intent(in) :: v(3)        !! velocity at the obstacle [m/s]
      real(wp), intent(inout) :: omega_r  !! W [m/s]
      type(boulder_result_t), intent(inout) :: result
      type(flight_t), intent(inout) :: flight
      type(scratch_t), intent(inout) :: scratch
      type(tree_impact_t) :: impact
      type(landing_t) :: place
      real(wp) :: energy, loss, speed_factor, turned(2), heading(2)
      integer :: k

      energy = sum(kinetic_energy(result%boulder, v, omega_r/result%boulder%radius))
      turned = v(1:2)
      heading = flight%heading
      if (obstacle%kind == tree) then
         call hit_tree(scene, number, obstacle%hit, landing, energy, result, scratch, impact)
         loss = impact%absorbed
         result%energy%trees = result%energy%trees + loss
         turned = rotated(turned, impact%sine, impact%cosine)
         heading = rotated(heading, impact%sine, impact%cosine)
      else
         call find_entry(scratch%crossings, scene%barriers(obstacle%number)%line, k)
         scratch%crossings%at(k)%v = v  ! exact velocity, unlike the mean speed of a roll
         scratch%crossings%at(k)%omega = omega_r/result%boulder%radius
         loss = min(energy, scene%barriers(obstacle%number)%capacity)
         result%energy%barriers = result%energy%barriers + loss
      end if
      speed_factor = 0
      if (energy > loss) speed_factor = sqrt((energy - loss)/energy)
      omega_r = speed_factor*omega_r
      place = landing
      if (obstacle%kind == barrier) place = point_in_front(scene%dem, landing, v(1:2))
      flight = flight_from(scene%dem, place, speed_factor*[turned, v(3)], heading)
      if (loss > 0 .and. is_slow(scene, squared_length(flight%v))) then
         result%status = merge(stopped_by_tree, stopped_by_barrier, obstacle%kind == tree)
      else if (result%trees_hit >= scene%max_impacts) then
         result%status = impact_limit
      end if
      if (obstacle%kind == barrier) scratch%crossings%at(k)%outcome = &
         int(merge(stopped_there, broken_through, result%status == stopped_by_barrier), i1)
      call record_vertex(scratch%record, vertex_t(landing%x, landing%y, landing%z, result%time, flight%v))
   end subroutine hit_obstacle

   !> Apply a hit of a tree, and record it.
   pure subroutine hit_tree(scene, number, hit, landing, energy, result, scratch, impact)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: number
      type(tree_hit_t), intent(in) :: hit
      type(landing_t), intent(in) :: landing
      real(wp), intent(in) :: energy  !! kinetic energy before the hit [J]
      type(boulder_result_t), intent(inout) :: result
      type(scratch_t), intent(inout) :: scratch
      type(tree_impact_t), intent(out) :: impact

      result%trees_hit = result%trees_hit + 1
      impact = tree_impact(scene%forest%model, scene%forest%stem(hit%tree), hit%offset, energy, &
                           random_words(scene%key, for_tree, number, int(result%trees_hit, i8), 0_i8))
      if (impact%breaks) scratch%felled = [scratch%felled, hit%tree]
      if (.not. scratch%tree_hits_requested) return
      call add_tree_hit(scratch%tree_hits, cell_of(scene%dem, landing%patch, landing%u, landing%w), hit%height, &
                        impact%absorbed)
   end subroutine hit_tree
end module rockfall_obstacles
