! SPDX-License-Identifier: BSD-3-Clause
!> Many boulders. The only file with threads: boulders are independent, results have a place of their
!> own, and tallies are exact, so threads and chunks cannot change a bit.
module rockfall_ensemble
   use rockfall_kinds, only: i8
   use rockfall_threads, only: team_size
   use rockfall_trajectory, only: scene_t, fate_t, crossing_t, scratch_t, follow, stopped, absorbed, left_window
   use rockfall_map, only: maps_t, add_visits, add_deposit
   use rockfall_histogram, only: histograms, bins, quantities
   implicit none
   private
   public :: run_boulders, trace_boulder

contains

   !> Follow boulders `first` to `first + size(fates) - 1`; add to maps and histogram counts. Those that left
   !> the window of the terrain (status) are in no tally.
   subroutine run_boulders(scene, first, threads, fates, crossings, maps, histogram_counts)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: first
      integer, intent(in) :: threads                         !! as for team_size
      type(fate_t), intent(out) :: fates(:)
      type(crossing_t), intent(inout) :: crossings(:, :)     !! (lines, boulders)
      type(maps_t), intent(in) :: maps
      integer(i8), intent(inout) :: histogram_counts(:, :)   !! (bins, quantities)

      !$omp parallel default(none) num_threads(team_size(threads)) &
      !$omp& shared(scene, first, fates, crossings, maps, histogram_counts)
      call run_share(scene, first, fates, crossings, maps, histogram_counts)
      !$omp end parallel
   end subroutine run_boulders

   !> One thread's share of the boulders. A procedure of its own, so that its work space starts as its
   !> type says: a private copy would not.
   subroutine run_share(scene, first, fates, crossings, maps, histogram_counts)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: first
      type(fate_t), intent(inout) :: fates(:)
      type(crossing_t), intent(inout) :: crossings(:, :)
      type(maps_t), intent(in) :: maps
      integer(i8), intent(inout) :: histogram_counts(:, :)
      type(scratch_t) :: scratch
      integer(i8) :: before(bins, quantities)
      integer :: k

      call prepare(scene, scratch)
      !$omp do schedule(dynamic, 16)
      do k = 1, size(fates)
         if (scene%wants_histograms) before = scratch%histograms%count
         call follow(scene, first + k - 1, fates(k), scratch)
         if (allocated(scratch%crossings)) crossings(:, k) = scratch%crossings
         if (fates(k)%status == left_window) then
            if (scene%wants_histograms) scratch%histograms%count = before
            cycle
         end if
         if (scene%wants_cells) call add_visits(maps, scratch%visits, fates(k)%boulder%mass)
         if (fates(k)%status == stopped .or. fates(k)%status == absorbed) then
            call add_deposit(maps, fates(k)%stop_cell)
         end if
      end do
      !$omp end do
      if (scene%wants_histograms) then
         !$omp critical
         histogram_counts = histogram_counts + scratch%histograms%count
         !$omp end critical
      end if
   end subroutine run_share

   !> Follow one boulder and keep its trajectory in `scratch%record`, of which the caller gives the size;
   !> `scratch%recorded` says how many vertices there were.
   subroutine trace_boulder(scene, number, room, fate, scratch)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: number
      integer, intent(in) :: room             !! vertices to keep
      type(fate_t), intent(out) :: fate
      type(scratch_t), intent(out) :: scratch

      call prepare(scene, scratch)
      allocate (scratch%record(room))
      call follow(scene, number, fate, scratch)
   end subroutine trace_boulder

   !> Work space for what the scene asks for.
   subroutine prepare(scene, scratch)
      type(scene_t), intent(in) :: scene
      type(scratch_t), intent(inout) :: scratch

      if (allocated(scene%lines)) allocate (scratch%crossings(size(scene%lines)))
      if (scene%wants_cells) allocate (scratch%spans(scene%dem%nx + scene%dem%ny))
      if (scene%wants_histograms) scratch%histograms = histograms()
   end subroutine prepare
end module rockfall_ensemble
