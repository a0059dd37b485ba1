! SPDX-License-Identifier: BSD-3-Clause
!> Boulders that may break: traces a boulder and its fragments one after the other, and adds their joint contribution to
!> the tallies. Each fragment is a boulder with its own random numbers; tallies count the released boulder (theory,
!> chapter 3):
!>
!> - a cell, a line or an object is reached once, with the maxima over the fragments that reached it;
!> - a deposit is counted for each fragment;
!> - the end of the boulder, and its recorded trajectory, are those of the fragment that travelled farthest.
module rockfall_fragments
   use rockfall_kinds, only: wp, i1, i8
   use rockfall_random, only: fragment_number
   use rockfall_boulder, only: kinetic_energy
   use rockfall_barrier, only: stopped_there, passed_over, broken_through
   use rockfall_flight, only: span_t
   use rockfall_maps, only: visits_t, start_visits, merge_visits
   use rockfall_passing_maps, only: merge_passing
   use rockfall_tree_maps, only: tree_hits_t, add_tree_hit
   use rockfall_histogram, only: bins, quantities
   use rockfall_scene_type, only: scene_t
   use rockfall_outcome, only: boulder_result_t, at_rest, broken, left_window
   use rockfall_crossings, only: crossing_t, crossings_t, start_crossings, find_entry
   use rockfall_record, only: record_t, stored_part, store_path
   use rockfall_scratch, only: scratch_t, piece_t, gathered_t, with_all, clear_scratch, find_all_hits
   use rockfall_start, only: start_boulder, energy_head
   use rockfall_breaking, only: break_at_release, fragment_piece
   use rockfall_trajectory, only: trace_full
   implicit none
   private
   public :: trace_fragments

   !> Outcomes at a barrier in ascending severity: of several fragments at the barrier, the last in this order counts.
   integer(i1), parameter :: rising_outcomes(*) = int([0, stopped_there, passed_over, broken_through], i1)

   !> Pieces to be traced.
   type :: pending_t
      integer :: n = 0
      type(piece_t), allocatable :: piece(:)
      integer(i8) :: born = 0        !! number of the last fragment created
   end type pending_t

   !> Sums and maxima over the pieces traced.
   type :: all_pieces_t
      type(boulder_result_t) :: result
      integer :: ended = 0           !! pieces that did not break
      real(wp) :: distance2 = -1     !! squared plan distance of the farthest piece [m2]
      type(visits_t) :: visits
      type(gathered_t) :: gathered
      type(tree_hits_t) :: tree_hits
      integer(i8) :: histogram(bins, quantities) = 0
      integer(i8), allocatable :: by_ground(:)
      type(crossings_t), allocatable :: crossings
      real(wp), allocatable :: raised(:, :)  !! (3, lines): maximum heights of lowest point, centre and upper edge of
                                             !! the fragments [m]
      real(wp), allocatable :: energy(:)     !! for each line, maximum energy of the fragments that crossed it [J]
      type(record_t) :: path         !! path of the fragment that travelled farthest
   end type all_pieces_t

contains

   !> Trace boulder `number` and its fragments, like `trace_full`.
   pure subroutine trace_fragments(scene, number, result, scratch, spans)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: number
      type(boulder_result_t), intent(out) :: result
      type(scratch_t), intent(inout) :: scratch
      type(span_t), intent(inout), contiguous :: spans(:)
      type(pending_t) :: pending
      type(all_pieces_t) :: all

      call clear_scratch(scene, with_all, scratch)
      call prepare(scratch, all)
      call release(scene, number, scratch, all, pending)
      if (all%result%status == left_window) pending%n = 0
      do while (pending%n > 0)
         scratch%start = pending%piece(pending%n)
         pending%n = pending%n - 1
         scratch%room = scene%breakage%max_fragments - all%ended - pending%n
         call trace_full(scene, scratch%start%number, result, scratch, spans)
         if (result%status == left_window) return
         if (result%status == broken) call add_fragments(scene, number, scratch, all, pending)
         call add_piece(scene, result, scratch, all)
      end do
      result = all%result
      if (result%status /= left_window) call hand_over(all, scratch)
   end subroutine trace_fragments

   !> Allocate the joint data of the pieces.
   pure subroutine prepare(scratch, all)
      type(scratch_t), intent(in) :: scratch
      type(all_pieces_t), intent(inout) :: all

      if (allocated(scratch%visits%time)) allocate (all%visits%time(0))
      if (scratch%cells_requested) call start_visits(all%visits)
      if (scratch%hits_requested) call start_visits(all%gathered%hits)
      if (scratch%passing_requested) call start_visits(all%gathered%passing)
      allocate (all%gathered%stop_cell(2, 1))
      if (allocated(scratch%by_ground)) allocate (all%by_ground(size(scratch%by_ground)), source=0_i8)
      if (.not. allocated(scratch%crossings)) return
      associate (lines => size(scratch%crossings%place))
         allocate (all%crossings)
         call start_crossings(lines, all%crossings)
         allocate (all%raised(3, lines), all%energy(lines), source=-1.0_wp)
      end associate
   end subroutine prepare

   !> Release a boulder, either as one block or broken into fragments.
   pure subroutine release(scene, number, scratch, all, pending)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: number
      type(scratch_t), intent(inout) :: scratch
      type(all_pieces_t), intent(inout) :: all
      type(pending_t), intent(inout) :: pending
      type(piece_t) :: whole

      whole%number = number
      call start_boulder(scene, number, with_all, whole%result, whole%flight)
      all%result = whole%result
      if (whole%result%status /= 0) return
      all%result%speed_max = 0
      whole%result%energy%released = energy_head(scene%gravity, whole%result%boulder, whole%flight)
      scratch%room = scene%breakage%max_fragments
      if (scene%breakage%at_release) call break_at_release(scene, whole%result, scratch)
      if (whole%result%status == broken) then
         scratch%broken = whole
         scratch%broken%result%speed_max = sqrt(whole%result%speed_max)
         scratch%broken%result%energy%released = whole%result%energy%released &
                                                 - whole%result%boulder%mass*scene%gravity*whole%flight%z
         call add_fragments(scene, number, scratch, all, pending)
         call add_counts(scratch%broken%result, all%result)
      else
         all%result%capped = whole%result%capped
         whole%result%capped = 0
         pending%piece = [whole]
         pending%n = 1
      end if
   end subroutine release

   !> Queue the fragments of the broken piece, and add the energy lost in breaking.
   pure subroutine add_fragments(scene, boulder, scratch, all, pending)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: boulder
      type(scratch_t), intent(in) :: scratch
      type(all_pieces_t), intent(inout) :: all
      type(pending_t), intent(inout) :: pending
      type(piece_t) :: fragment
      real(wp) :: kinetic
      integer :: k

      associate (from => scratch%broken)
         kinetic = kinetic_of(from)
         do k = 1, size(scratch%split%volume)
            pending%born = pending%born + 1
            fragment = fragment_piece(scene, scratch, k, fragment_number(boulder, pending%born))
            kinetic = kinetic - kinetic_of(fragment)
            call add_pending(pending, fragment)
         end do
      end associate
      all%result%fines = all%result%fines + scratch%split%fines
      all%result%energy%breakage = all%result%energy%breakage + kinetic
   end subroutine add_fragments

   pure real(wp) function kinetic_of(piece)
      type(piece_t), intent(in) :: piece

      associate (boulder => piece%result%boulder)
         kinetic_of = sum(kinetic_energy(boulder, piece%flight%v, piece%omega_r/boulder%radius))
      end associate
   end function kinetic_of

   pure subroutine add_pending(pending, piece)
      type(pending_t), intent(inout) :: pending
      type(piece_t), intent(in) :: piece
      type(piece_t), allocatable :: longer(:)

      if (.not. allocated(pending%piece)) allocate (pending%piece(16))
      if (pending%n == size(pending%piece)) then
         allocate (longer(2*pending%n + 16))
         longer(:pending%n) = pending%piece
         call move_alloc(longer, pending%piece)
      end if
      pending%n = pending%n + 1
      pending%piece(pending%n) = piece
   end subroutine add_pending

   !> Add a piece that was traced until it ended or broke.
   pure subroutine add_piece(scene, result, scratch, all)
      type(scene_t), intent(in) :: scene
      type(boulder_result_t), intent(in) :: result
      type(scratch_t), intent(in) :: scratch
      type(all_pieces_t), intent(inout) :: all
      type(visits_t) :: hits
      integer :: k, entry

      associate (mass => result%boulder%mass)
         if (scratch%cells_requested) call merge_visits(all%visits, scratch%visits, mass)
         if (scratch%hits_requested) then
            call find_all_hits(scene, result%boulder%radius, scratch%paths, hits)
            call merge_visits(all%gathered%hits, hits, mass)
         end if
      end associate
      if (scratch%passing_requested) &
         call merge_passing(all%gathered%passing, scratch%visits, scene%dem, result%boulder%radius)
      do k = 1, scratch%tree_hits%n
         associate (hit => scratch%tree_hits%hit(k))
            call add_tree_hit(all%tree_hits, hit%cell, hit%height, hit%absorbed)
         end associate
      end do
      if (scene%histograms_requested) all%histogram = all%histogram + scratch%histograms%count
      if (allocated(all%by_ground)) all%by_ground = all%by_ground + scratch%by_ground
      if (allocated(all%crossings)) then
         do k = 1, scratch%crossings%n
            associate (line => scratch%crossings%at(k)%line)
               call find_entry(all%crossings, line, entry)
               call add_crossing(result, scratch%crossings%at(k), all%crossings%at(entry), all%energy(line), &
                                 all%raised(:, line))
            end associate
         end do
      end if
      call add_counts(result, all%result)
      if (result%status /= broken) call add_end(result, scratch, all)
   end subroutine add_piece

   !> Add the counts, maxima and energies of a piece.
   pure subroutine add_counts(piece, all)
      type(boulder_result_t), intent(in) :: piece
      type(boulder_result_t), intent(inout) :: all

      all%speed_max = max(all%speed_max, piece%speed_max)
      all%jump_height_max = max(all%jump_height_max, piece%jump_height_max)
      all%rebounds = all%rebounds + piece%rebounds
      all%redrawn = all%redrawn + piece%redrawn
      all%forced = all%forced + piece%forced
      all%out_of_range = all%out_of_range + piece%out_of_range
      all%out_of_speed = all%out_of_speed + piece%out_of_speed
      all%out_of_angle = all%out_of_angle + piece%out_of_angle
      all%trees_hit = all%trees_hit + piece%trees_hit
      all%breakages = all%breakages + piece%breakages
      all%capped = all%capped + piece%capped
      all%energy%released = all%energy%released + piece%energy%released
      all%energy%ground = all%energy%ground + piece%energy%ground
      all%energy%trees = all%energy%trees + piece%energy%trees
      all%energy%barriers = all%energy%barriers + piece%energy%barriers
      all%energy%left = all%energy%left + piece%energy%left
   end subroutine add_counts

   !> Add the end of a piece, which may be the farthest.
   pure subroutine add_end(result, scratch, all)
      type(boulder_result_t), intent(in) :: result
      type(scratch_t), intent(in) :: scratch
      type(all_pieces_t), intent(inout) :: all
      real(wp) :: distance2

      all%ended = all%ended + 1
      all%result%fragments = all%ended
      if (at_rest(result%status)) call add_stop(all%gathered, result%stop_cell)
      distance2 = sum((result%stop(:2) - result%start(:2))**2)
      if (distance2 <= all%distance2) return
      all%distance2 = distance2
      all%result%status = result%status
      all%result%impacts = result%impacts
      all%result%stop = result%stop
      all%result%stop_cell = result%stop_cell
      all%result%path_length = result%path_length
      all%result%time = result%time
      all%path = stored_part(scratch%record)
   end subroutine add_end

   pure subroutine add_stop(gathered, cell)
      type(gathered_t), intent(inout) :: gathered
      integer, intent(in) :: cell(2)  !! column, row
      integer, allocatable :: longer(:, :)

      if (gathered%stops == size(gathered%stop_cell, 2)) then
         allocate (longer(2, 2*gathered%stops))
         longer(:, :gathered%stops) = gathered%stop_cell
         call move_alloc(longer, gathered%stop_cell)
      end if
      gathered%stops = gathered%stops + 1
      gathered%stop_cell(:, gathered%stops) = cell
   end subroutine add_stop

   !> Add the crossing of a line by a piece: keep the crossing with the highest energy, and the maximum heights of all.
   pure subroutine add_crossing(result, piece, all, energy, raised)
      type(boulder_result_t), intent(in) :: result
      type(crossing_t), intent(in) :: piece
      type(crossing_t), intent(inout) :: all
      real(wp), intent(inout) :: energy     !! maximum energy so far [J]
      real(wp), intent(inout) :: raised(3)  !! maximum heights so far [m]: lowest point, centre, upper edge
      real(wp) :: energy_here
      integer :: fragments
      integer(i1) :: outcome

      outcome = more_severe(all%outcome, piece%outcome)
      fragments = all%fragments
      if (piece%crossed) then
         fragments = fragments + 1
         energy_here = sum(kinetic_energy(result%boulder, piece%v, piece%omega))
         raised = max(raised, [piece%jump_height, piece%passing_height, piece%passing_height + result%boulder%radius])
         if (energy_here > energy) then
            energy = energy_here
            all = piece
            all%fragment = result%boulder
         end if
      end if
      all%outcome = outcome
      all%fragments = fragments
   end subroutine add_crossing

   !> More severe of two outcomes at a barrier, for the objects below it.
   pure integer(i1) function more_severe(a, b)
      integer(i1), intent(in) :: a, b

      more_severe = rising_outcomes(max(findloc(rising_outcomes, a, dim=1), findloc(rising_outcomes, b, dim=1)))
   end function more_severe

   !> Move the joint contribution of all pieces to the work space, as if it came from one boulder. At each line, the
   !> heights are the maxima of lowest point, centre and upper edge over the fragments that crossed.
   pure subroutine hand_over(all, scratch)
      type(all_pieces_t), intent(inout) :: all
      type(scratch_t), intent(inout) :: scratch
      integer :: k

      if (scratch%cells_requested) scratch%visits = all%visits
      scratch%gathered = all%gathered
      scratch%tree_hits = all%tree_hits
      scratch%histograms%count = all%histogram
      if (allocated(all%by_ground)) scratch%by_ground = all%by_ground
      if (allocated(all%crossings)) then
         do k = 1, all%crossings%n
            associate (at => all%crossings%at(k))
               if (.not. at%crossed) cycle
               call raise(maxval(all%raised(:, at%line) - [at%jump_height, at%passing_height, &
                                                     at%passing_height + at%fragment%radius]), at)
            end associate
         end do
         scratch%crossings = all%crossings
      end if
      call store_path(all%path, scratch%record)
   end subroutine hand_over

   pure subroutine raise(by, crossing)
      real(wp), intent(in) :: by  !! height difference >= 0 [m]
      type(crossing_t), intent(inout) :: crossing

      crossing%jump_height = crossing%jump_height + by
      crossing%passing_height = crossing%passing_height + by
   end subroutine raise
end module rockfall_fragments
