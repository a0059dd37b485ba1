! SPDX-License-Identifier: BSD-3-Clause
!> Many boulders. The only file in which they share threads: boulders are independent, results have a place of their
!> own, and tallies are exact, so threads and chunks cannot change a bit.
module rockfall_ensemble
   use rockfall_kinds, only: i8
   use rockfall_threads, only: team_size
   use rockfall_trajectory, only: scene_t, fate_t, crossing_t, scratch_t, follow, choose_follow, stopped, absorbed, &
                                  left_window
   use rockfall_boulder, only: release_t, source_of, first_of, last_of, released_by
   use rockfall_map, only: maps_t, visits_t, start_visits, add_visits, add_deposit
   use rockfall_sourcemap, only: tells_sources, gather, add_source, stamp_source
   use rockfall_histogram, only: histograms, bins, quantities
   implicit none
   private
   public :: run_boulders, trace_boulder

   integer, parameter :: batch = 16  !! boulders that a thread takes at a time
   integer, parameter :: few = 256   !! boulders of a source that one thread flies alone

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
      !$omp& shared(scene, first, threads, fates, crossings, maps, histogram_counts)
      call run_share(scene, first, threads, fates, crossings, maps, histogram_counts)
      !$omp end parallel
   end subroutine run_boulders

   !> One thread's share of the boulders. A procedure of its own, so that its work space starts as its
   !> type says: a private copy would not.
   subroutine run_share(scene, first, threads, fates, crossings, maps, histogram_counts)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: first
      integer, intent(in) :: threads
      type(fate_t), intent(inout) :: fates(:)
      type(crossing_t), intent(inout) :: crossings(:, :)
      type(maps_t), intent(in) :: maps
      integer(i8), intent(inout) :: histogram_counts(:, :)
      type(scratch_t) :: scratch
      integer :: k

      call prepare(scene, scratch)
      if (tells_sources(maps)) then
         call run_by_source(scene, first, threads, fates, crossings, maps, scratch)
      else
         !$omp do schedule(dynamic, batch)
         do k = 1, size(fates)
            call run_one(scene, first + k - 1, fates(k), crossings(:, k), maps, scratch)
         end do
         !$omp end do
      end if
      if (scene%wants_histograms) then
         !$omp critical
         histogram_counts = histogram_counts + scratch%histograms%count
         !$omp end critical
      end if
   end subroutine run_share

   !> Follow a boulder and add it to the maps, unless it left the window of the terrain.
   subroutine run_one(scene, number, fate, crossings, maps, scratch)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: number
      type(fate_t), intent(inout) :: fate
      type(crossing_t), intent(inout) :: crossings(:)
      type(maps_t), intent(in) :: maps
      type(scratch_t), intent(inout) :: scratch
      integer(i8) :: before(bins, quantities)

      if (scene%wants_histograms) before = scratch%histograms%count
      call scratch%follow(scene, number, fate, scratch)
      if (allocated(scratch%crossings)) crossings = scratch%crossings
      if (fate%status == left_window) then
         if (scene%wants_histograms) scratch%histograms%count = before
         return
      end if
      if (scene%wants_cells) call add_visits(maps, scratch%visits, fate%boulder%mass)
      if (fate%status == stopped .or. fate%status == absorbed) call add_deposit(maps, fate%stop_cell)
   end subroutine run_one

   !> One thread's share where maps tell sources apart. All threads walk through the sources of the call in
   !> step: small ones that are here as a whole they share out, each to a thread; the boulders of another
   !> source they share, and wait for each other at its end, because the next one stamps the same cells.
   subroutine run_by_source(scene, first, threads, fates, crossings, maps, scratch)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: first
      integer, intent(in) :: threads
      type(fate_t), intent(inout) :: fates(:)
      type(crossing_t), intent(inout) :: crossings(:, :)
      type(maps_t), intent(in) :: maps
      type(scratch_t), intent(inout) :: scratch
      type(visits_t) :: cells
      integer(i8) :: last, next, source, to, s, b, most
      integer :: k, share

      last = first + size(fates) - 1
      most = max(few, size(fates)/(8*team_size(threads)))
      next = first
      do while (next <= last)
         source = source_of(scene%release, next)
         to = last_of_small(scene%release, source, next, last, most)
         if (to < source) then
            !$omp do schedule(dynamic, batch)
            do b = next, min(last, last_of(scene%release, source))
               k = int(b - first) + 1
               call run_one(scene, b, fates(k), crossings(:, k), maps, scratch)
               call stamp_source(maps, scratch%visits, source, released_by(scene%release, source))
            end do
            !$omp end do
            to = source
         else
            share = int(max(1_i8, batch*(to - source + 1)/max(1_i8, last_of(scene%release, to) - next + 1)))
            !$omp do schedule(dynamic, share)
            do s = source, to
               call start_visits(cells, s)
               do b = first_of(scene%release, s), last_of(scene%release, s)
                  k = int(b - first) + 1
                  call run_one(scene, b, fates(k), crossings(:, k), maps, scratch)
                  call gather(cells, scratch%visits)
               end do
               call add_source(maps, cells, released_by(scene%release, s))
            end do
            !$omp end do nowait
         end if
         next = last_of(scene%release, to) + 1
      end do
   end subroutine run_by_source

   !> The last of the sources from `source` on that have at most `most` boulders, all of them within
   !> first..last; source - 1 without any.
   pure integer(i8) function last_of_small(release, source, first, last, most) result(to)
      type(release_t), intent(in) :: release
      integer(i8), intent(in) :: source, first, last, most

      to = source - 1
      if (first > first_of(release, source)) return
      do
         if (last_of(release, to + 1) > last .or. released_by(release, to + 1) > most) return
         to = to + 1
         if (last_of(release, to) >= last) return
      end do
   end function last_of_small

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

      call choose_follow(scene, scratch)
      if (allocated(scene%lines)) allocate (scratch%crossings(size(scene%lines)))
      if (scene%wants_cells) allocate (scratch%spans(scene%dem%nx + scene%dem%ny))
      if (scene%wants_histograms) scratch%histograms = histograms()
   end subroutine prepare
end module rockfall_ensemble
