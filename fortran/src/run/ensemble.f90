! SPDX-License-Identifier: BSD-3-Clause
!> Runs of many boulders, distributed over threads (only in this file). Boulders are independent, each result has its
!> own element, and tallies are exact, so results do not depend on threads or chunks.
module rockfall_ensemble
   use, intrinsic :: iso_c_binding, only: c_int
   use omp_lib, only: omp_get_thread_num
   use rockfall_kinds, only: wp, i8
   use rockfall_threads, only: team_size, deadline_in, take_batch, batch
   use rockfall_flight, only: span_t
   use rockfall_scene_type, only: scene_t, goes_in_lanes, has_obstacles, one_by_one, narrow_lanes, wide_lanes, &
                                  masked_lanes
   use rockfall_outcome, only: boulder_result_t
   use rockfall_crossings, only: crossings_t, keep_crossings
   use rockfall_scratch, only: scratch_t
   use rockfall_trajectory, only: trace_full, choose_tracer
   use rockfall_fragments, only: trace_fragments
   use rockfall_shares, only: proportional_part
   use rockfall_boulder, only: release_t, source_of, first_of, last_of, released_by
   use rockfall_tallies, only: totals_t, prepare_scratch, add_boulder
   use rockfall_lanes, only: run_in_lanes
   use rockfall_wide_lanes, only: run_in_wide_lanes => run_in_lanes
   use rockfall_masked_lanes, only: run_in_masked_lanes => run_in_lanes
   use rockfall_maps, only: maps_t, init_locks, free_locks, needs_visits, needs_heights, visits_t, start_visits, &
                            join_visits
   use rockfall_source_maps, only: counts_sources, gather_cells, add_source, add_source_of_boulder
   implicit none
   private
   public :: run_boulders, trace_boulder, recorded_boulders

   real(wp), parameter :: quick_batch = 0.02_wp  !! maximum time of a batch [s]; slower boulders are taken singly
   !> Maximum size of a source that one thread runs alone: `max_alone` boulders in small calls; in larger calls, a size
   !> that gives each thread about `turns_per_thread` sources.
   integer, parameter :: max_alone = 256, turns_per_thread = 8

   !> Work space of a thread.
   type :: worker_t
      procedure(trace_full), pointer, nopass :: trace => null()  !! procedure for boulders that run one by one
      type(scratch_t) :: scratch
      type(span_t), allocatable :: spans(:)
      type(totals_t) :: totals
   end type worker_t

   interface
      !> Best kind of lanes that the processor supports: narrow_lanes, wide_lanes or masked_lanes.
      integer(c_int) function supported_lanes() bind(c, name="rockfall_supported_lanes")
         import :: c_int
      end function supported_lanes
   end interface

contains

   !> Run boulders `first`, `first + step` and so on, for all elements of `results`; add them to maps and histogram
   !> counts. Boulders that left the window of the terrain (see their status) are not counted. Threads add to private or
   !> to common maps. No boulder starts after `seconds`: the first `done` boulders, at least one, are completed.
   subroutine run_boulders(scene, first, step, threads, results, crossings, maps, histogram_counts, by_ground, &
                           seconds, done)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: first, step                 !! first number; step to the next (1 if maps count sources)
      integer, intent(in) :: threads                         !! as for team_size
      type(boulder_result_t), intent(out) :: results(:)
      type(crossings_t), intent(inout) :: crossings(:)       !! crossings of each boulder, if there are lines
      type(maps_t), intent(in) :: maps(:)                    !! a single element, or one for each thread
      integer(i8), intent(inout) :: histogram_counts(:, :)   !! counts (bins, quantities)
      integer(i8), intent(inout) :: by_ground(:)             !! number of rebounds on each ground, if there are several
      real(wp), intent(in), optional :: seconds              !! time limit [s]; no effect if maps count sources
      integer(i8), intent(out), optional :: done

      integer(i8) :: deadline
      type(maps_t) :: maps_of_thread(size(maps))
      logical :: are_shared
      integer :: next

      maps_of_thread = maps
      are_shared = team_size(threads) > size(maps)
      if (are_shared) call init_locks(maps_of_thread(1), scene%dem%ny)
      next = 1
      deadline = huge(deadline)
      if (present(seconds)) deadline = deadline_in(seconds)
      !$omp parallel default(none) num_threads(team_size(threads)) &
      !$omp& shared(scene, first, step, threads, results, crossings, maps_of_thread, histogram_counts, by_ground) &
      !$omp& shared(next) firstprivate(deadline)
      call run_thread(scene, first, step, threads, results, crossings, &
                      maps_of_thread(min(omp_get_thread_num() + 1, size(maps_of_thread))), histogram_counts, &
                      by_ground, next, deadline)
      !$omp end parallel
      if (present(done)) done = merge(size(results), min(next - 1, size(results)), counts_sources(maps(1)))
      if (are_shared) call free_locks(maps_of_thread(1))
   end subroutine run_boulders

   !> Run one thread's share of the boulders. A separate procedure, so that its work space is default-initialised,
   !> unlike private copies.
   subroutine run_thread(scene, first, step, threads, results, crossings, maps, histogram_counts, by_ground, next, &
                         deadline)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: first, step
      integer, intent(in) :: threads
      type(boulder_result_t), intent(inout) :: results(:)
      type(crossings_t), intent(inout) :: crossings(:)
      type(maps_t), intent(in) :: maps
      integer(i8), intent(inout) :: histogram_counts(:, :), by_ground(:)
      integer, intent(inout) :: next
      integer(i8), intent(in) :: deadline
      type(worker_t) :: worker
      integer :: lanes

      lanes = one_by_one
      if (goes_in_lanes(scene) .and. .not. counts_sources(maps)) lanes = scene%lanes
      lanes = min(lanes, supported_lanes())
      if (allocated(scene%grounds)) allocate (worker%totals%by_ground(size(scene%grounds)), source=0_i8)
      if (lanes == masked_lanes) then
         call run_in_masked_lanes(scene, first, step, results, crossings, maps, next, deadline, worker%totals)
      else if (lanes == wide_lanes) then
         call run_in_wide_lanes(scene, first, step, results, crossings, maps, next, deadline, worker%totals)
      else if (lanes == narrow_lanes) then
         call run_in_lanes(scene, first, step, results, crossings, maps, next, deadline, worker%totals)
      else
         allocate (worker%spans(merge(scene%dem%nx + scene%dem%ny, 0, needs_heights(maps) .or. has_obstacles(scene))))
         call choose_tracer(scene, needs_visits(maps), worker%trace)
         if (allocated(scene%breakage)) worker%trace => trace_fragments
         call prepare_scratch(scene, maps, worker%scratch)
         if (counts_sources(maps)) then
            call run_by_source(scene, first, threads, results, crossings, maps, worker)
         else
            call run_one_by_one(scene, first, step, results, crossings, maps, next, deadline, worker)
         end if
      end if
      !$omp critical
      if (scene%histograms_requested) histogram_counts = histogram_counts + worker%totals%histogram
      if (allocated(scene%grounds)) call add_by_ground(scene, worker%totals%by_ground, by_ground)
      !$omp end critical
   end subroutine run_thread

   !> Add the rebounds on all grounds of a scene to the counts for the grounds of its cells.
   pure subroutine add_by_ground(scene, rebounds, by_ground)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: rebounds(:)      !! rebounds on each ground of the scene
      integer(i8), intent(inout) :: by_ground(:)
      integer :: ground, k

      by_ground = by_ground + rebounds(:size(by_ground))
      if (size(by_ground) == size(rebounds)) return
      do ground = 1, size(by_ground)
         do k = size(by_ground) + 1, size(rebounds)
            if (any(scene%shapes%ground(ground, :) == k)) by_ground(ground) = by_ground(ground) + rebounds(k)
         end do
      end do
   end subroutine add_by_ground

   !> Run one thread's share of the boulders, in batches from the shared counter `next`; slow boulders are taken singly.
   subroutine run_one_by_one(scene, first, step, results, crossings, maps, next, deadline, worker)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: first, step, deadline
      type(boulder_result_t), intent(inout) :: results(:)
      type(crossings_t), intent(inout) :: crossings(:)
      type(maps_t), intent(in) :: maps
      integer, intent(inout) :: next
      type(worker_t), intent(inout) :: worker
      integer(i8) :: quick
      integer :: k, from, to

      quick = deadline_in(0.0_wp)  ! the duration of a boulder is unknown before the first
      do
         call take_batch(next, size(results), merge(batch, 1, deadline_in(0.0_wp) < quick), deadline, from, to)
         if (from > to) return
         quick = deadline_in(quick_batch)
         do k = from, to
            call run_boulder(scene, first + (k - 1)*step, results(k), crossings(k), maps, worker)
         end do
      end do
   end subroutine run_one_by_one

   !> Trace a boulder and add it to the tallies.
   subroutine run_boulder(scene, number, result, crossings, maps, worker)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: number
      type(boulder_result_t), intent(inout) :: result
      type(crossings_t), intent(inout) :: crossings
      type(maps_t), intent(in) :: maps
      type(worker_t), intent(inout) :: worker

      call worker%trace(scene, number, result, worker%scratch, worker%spans)
      if (allocated(worker%scratch%crossings)) call keep_crossings(worker%scratch%crossings, crossings)
      call add_boulder(scene, maps, result, worker%scratch, worker%totals)
   end subroutine run_boulder

   !> Run one thread's share if maps count sources. All threads process the sources in the same order. One thread runs
   !> each small source that is complete in this call. Threads share the boulders of other sources, with a barrier at
   !> the end of each source, because the next source marks the same cells.
   subroutine run_by_source(scene, first, threads, results, crossings, maps, worker)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: first
      integer, intent(in) :: threads
      type(boulder_result_t), intent(inout) :: results(:)
      type(crossings_t), intent(inout) :: crossings(:)
      type(maps_t), intent(in) :: maps
      type(worker_t), intent(inout) :: worker
      type(visits_t) :: cells
      integer(i8) :: last, next, source, to, s, b, max_size
      integer :: k, sources

      last = first + size(results) - 1
      max_size = max(max_alone, size(results)/(turns_per_thread*team_size(threads)))
      next = first
      do while (next <= last)
         source = source_of(scene%release, next)
         to = last_small_source(scene%release, source, next, last, max_size)
         if (to < source) then
            !$omp do schedule(dynamic, batch)
            do b = next, min(last, last_of(scene%release, source))
               k = int(b - first) + 1
               call run_boulder(scene, b, results(k), crossings(k), maps, worker)
               call add_source_of_boulder(maps, worker%scratch%visits, source, released_by(scene%release, source))
            end do
            !$omp end do
            to = source
         else
            ! group small sources into about one batch of boulders
            sources = int(max(1_i8, batch*(to - source + 1)/max(1_i8, last_of(scene%release, to) - next + 1)))
            !$omp do schedule(dynamic, sources)
            do s = source, to
               call start_visits(cells)
               do b = first_of(scene%release, s), last_of(scene%release, s)
                  k = int(b - first) + 1
                  call run_boulder(scene, b, results(k), crossings(k), maps, worker)
                  call gather_cells(cells, worker%scratch%visits)
               end do
               call join_visits(cells)
               call add_source(maps, cells, released_by(scene%release, s))
            end do
            !$omp end do nowait
         end if
         next = last_of(scene%release, to) + 1
      end do
   end subroutine run_by_source

   !> Last of the consecutive sources from `source` that have at most `max_size` boulders each, all within first..last;
   !> source - 1 if none.
   pure integer(i8) function last_small_source(release, source, first, last, max_size) result(to)
      type(release_t), intent(in) :: release
      integer(i8), intent(in) :: source, first, last, max_size

      to = source - 1
      if (first > first_of(release, source)) return
      do
         if (last_of(release, to + 1) > last .or. released_by(release, to + 1) > max_size) return
         to = to + 1
         if (last_of(release, to) >= last) return
      end do
   end function last_small_source

   !> Trace one boulder and store its trajectory in `scratch%record`, which has space for `max_vertices`; all vertices
   !> are counted.
   subroutine trace_boulder(scene, number, max_vertices, result, scratch)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: number
      integer, intent(in) :: max_vertices     !! maximum number of vertices to store
      type(boulder_result_t), intent(out) :: result
      type(scratch_t), intent(out) :: scratch

      type(span_t), allocatable :: spans(:)
      type(maps_t) :: no_maps

      allocate (spans(merge(scene%dem%nx + scene%dem%ny, 0, has_obstacles(scene))))
      call prepare_scratch(scene, no_maps, scratch)
      allocate (scratch%record%vertex(max_vertices))
      if (allocated(scene%breakage)) then
         call trace_fragments(scene, number, result, scratch, spans)
      else
         call trace_full(scene, number, result, scratch, spans)
      end if
   end subroutine trace_boulder

   !> Numbers of the boulders in first..last whose trajectories are recorded. In the complete run, `requested` boulders
   !> are recorded: the first of each source, in proportion to its number of boulders. The choice does not depend on the
   !> range.
   pure function recorded_boulders(release, requested, first, last) result(number)
      type(release_t), intent(in) :: release
      integer(i8), intent(in) :: requested, first, last
      integer(i8), allocatable :: number(:)
      integer(i8) :: n_boulders, first_own, last_own, k, n, n_recorded, source
      integer :: pass

      n_boulders = last_of(release, size(release%x, kind=i8))
      n_recorded = min(requested, n_boulders)
      do pass = 1, 2  ! count first, then store
         n = 0
         if (last >= first) then
            do source = source_of(release, first), source_of(release, last)
               first_own = first_of(release, source)
               last_own = first_own - 1 + proportional_part(n_recorded, last_of(release, source), n_boulders) &
                          - proportional_part(n_recorded, first_own - 1, n_boulders)
               do k = max(first, first_own), min(last, last_own)
                  n = n + 1
                  if (pass == 2) number(n) = k
               end do
            end do
         end if
         if (pass == 1) allocate (number(n))
      end do
   end function recorded_boulders
end module rockfall_ensemble
