! SPDX-License-Identifier: BSD-3-Clause
!> Contribution of a finished boulder to the tallies of a run. A boulder that left the window of the terrain is not
!> counted, because it is traced again.
module rockfall_tallies
   use rockfall_kinds, only: wp, i8
   use rockfall_scene_type, only: scene_t
   use rockfall_crossings, only: start_crossings
   use rockfall_outcome, only: boulder_result_t, at_rest, left_window
   use rockfall_scratch, only: scratch_t, find_all_hits
   use rockfall_maps, only: maps_t, visits_t, needs_visits, needs_heights, join_visits, add_visits, add_deposit
   use rockfall_travel_maps, only: needs_times, needs_travel, add_travel
   use rockfall_passing_maps, only: needs_passing, add_passing
   use rockfall_hit_maps, only: needs_hits, add_hits
   use rockfall_tree_maps, only: needs_tree_hits, add_tree_hits
   use rockfall_histogram, only: empty_histograms, bins, quantities
   implicit none
   private
   public :: totals_t, prepare_scratch, add_boulder

   !> Totals over the boulders of one thread.
   type :: totals_t
      integer(i8) :: histogram(bins, quantities) = 0
      integer(i8), allocatable :: by_ground(:)  !! rebounds, if the scene has several grounds
      type(visits_t), private :: hits           !! work space for the hits of a boulder
   end type totals_t

contains

   !> Allocate the work space of a boulder for a run.
   subroutine prepare_scratch(scene, maps, scratch)
      type(scene_t), intent(in) :: scene
      type(maps_t), intent(in) :: maps
      type(scratch_t), intent(inout) :: scratch

      scratch%cells_requested = needs_visits(maps)
      scratch%heights_requested = needs_heights(maps)
      scratch%hits_requested = needs_hits(maps)
      if (needs_times(maps)) allocate (scratch%visits%time(0))
      if (allocated(scene%breakage)) allocate (scratch%gathered)
      scratch%passing_requested = needs_passing(maps)
      scratch%tree_hits_requested = allocated(scene%forest) .and. needs_tree_hits(maps)
      if (allocated(scene%lines)) then
         allocate (scratch%crossings)
         call start_crossings(size(scene%lines), scratch%crossings)
      end if
      if (scene%histograms_requested) scratch%histograms = empty_histograms()
      if (allocated(scene%grounds)) allocate (scratch%by_ground(size(scene%grounds)), source=0_i8)
   end subroutine prepare_scratch

   !> Add a boulder to maps and totals. Thread-safe if each thread has its own totals.
   subroutine add_boulder(scene, maps, result, scratch, totals)
      type(scene_t), intent(in) :: scene
      type(maps_t), intent(in) :: maps
      type(boulder_result_t), intent(in) :: result
      type(scratch_t), intent(inout) :: scratch  !! on return, visits are joined
      type(totals_t), intent(inout) :: totals
      real(wp) :: mass
      integer :: k

      if (result%status == left_window) return
      if (scratch%cells_requested) call join_visits(scratch%visits)
      mass = result%boulder%mass
      if (allocated(scratch%gathered)) mass = 1  ! the energies of visits already include the mass
      if (scene%histograms_requested) totals%histogram = totals%histogram + scratch%histograms%count
      if (allocated(scratch%by_ground)) totals%by_ground = totals%by_ground + scratch%by_ground
      if (scratch%cells_requested) call add_visits(maps, scratch%visits, mass)
      if (needs_passing(maps) .and. .not. allocated(scratch%gathered)) &
         call add_passing(maps, scratch%visits, scene%dem, result%boulder%radius)
      if (needs_travel(maps)) call add_travel(maps, scratch%visits, scene%dem, result%start)
      if (scratch%tree_hits_requested) call add_tree_hits(maps, scratch%tree_hits)
      if (.not. allocated(scratch%gathered)) then
         if (scratch%hits_requested) then
            call find_all_hits(scene, result%boulder%radius, scratch%paths, totals%hits)
            call add_hits(maps, totals%hits, mass)
         end if
         if (at_rest(result%status)) call add_deposit(maps, result%stop_cell)
         return
      end if
      if (scratch%hits_requested) then
         call join_visits(scratch%gathered%hits)
         call add_hits(maps, scratch%gathered%hits, mass)
      end if
      if (needs_passing(maps)) then
         call join_visits(scratch%gathered%passing)
         call add_passing(maps, scratch%gathered%passing, scene%dem, 0.0_wp)
      end if
      do k = 1, scratch%gathered%stops
         call add_deposit(maps, scratch%gathered%stop_cell(:, k))
      end do
   end subroutine add_boulder
end module rockfall_tallies
