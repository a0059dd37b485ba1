! SPDX-License-Identifier: BSD-3-Clause
!> Crossings of evaluation lines and of barriers.
module rockfall_crossings
   use rockfall_kinds, only: wp, i1
   use rockfall_terrain, only: patch_t, locate, height, gradient, steepness_of
   use rockfall_flight, only: flight_t, landing_t
   use rockfall_boulder, only: boulder_t
   use rockfall_line, only: first_meeting
   use rockfall_line_index, only: buckets_of
   use rockfall_scene_type, only: scene_t
   use rockfall_outcome, only: boulder_result_t
   implicit none
   private
   public :: crossing_t, crossings_t, crossing, record_crossings, start_crossings, clear_crossings, keep_crossings, &
             outcome_at, find_entry

   !> First crossing of an evaluation line, or the crossing at which a barrier is hit.
   type :: crossing_t
      logical :: crossed = .false.
      integer(i1) :: outcome = 0       !! outcome at the barrier (rockfall_barrier); 0: not hit
      real(wp) :: x = 0, y = 0, time = 0  !! local coordinates [m]; time since release [s]
      real(wp) :: v(3) = 0, omega = 0  !! [m/s], [rad/s]
      real(wp) :: jump_height = 0      !! height of the lowest point above the surface [m]
      real(wp) :: passing_height = 0   !! vertical height of the sphere's centre above the surface [m]
      integer :: line = 0              !! index of the line
      integer :: fragments = 0         !! number of fragments that crossed, if boulders may break
      type(boulder_t) :: fragment = boulder_t()  !! fragment to which the other values belong
   end type crossing_t

   !> Crossings of a boulder, stored only for the few lines that it crosses.
   type :: crossings_t
      integer :: n = 0
      type(crossing_t), allocatable :: at(:)  !! the first n are used
      integer, allocatable :: place(:)        !! index of each line in `at`, 0: none; only while the boulder moves
   end type crossings_t

   integer, parameter :: first_room = 4  !! initial capacity [crossings]

contains

   !> Record the first crossings of lines along a flight, up to a time.
   pure subroutine record_crossings(scene, gravity, result, flight, landing, omega_r, crossings, until)
      type(scene_t), intent(in) :: scene
      real(wp), intent(in) :: gravity  !! gravity along the path [m/s2]
      type(boulder_result_t), intent(in) :: result
      type(flight_t), intent(in) :: flight
      type(landing_t), intent(in) :: landing
      real(wp), intent(in) :: omega_r  !! W [m/s]
      type(crossings_t), intent(inout) :: crossings
      real(wp), intent(in), optional :: until  !! time since the start of the flight [s]
      integer :: columns(2), rows(2), k, j

      if (.not. allocated(scene%line_index)) then
         do k = 1, size(scene%lines)
            call record_crossing(scene, gravity, result, flight, landing, omega_r, k, crossings, until)
         end do
         return
      end if
      associate (index => scene%line_index)
         call buckets_of(index, [flight%x, flight%y], [landing%x, landing%y], columns, rows)
         do j = (rows(1) - 1)*index%n(1), (rows(2) - 1)*index%n(1), index%n(1)
            do k = index%first(j + columns(1)), index%first(j + columns(2) + 1) - 1
               call record_crossing(scene, gravity, result, flight, landing, omega_r, index%line(k), crossings, until)
            end do
         end do
      end associate
   end subroutine record_crossings

   !> Record the first crossing of a line, unless an earlier flight crossed it.
   pure subroutine record_crossing(scene, gravity, result, flight, landing, omega_r, line, crossings, until)
      type(scene_t), intent(in) :: scene
      real(wp), intent(in) :: gravity  !! [m/s2]
      type(boulder_result_t), intent(in) :: result
      type(flight_t), intent(in) :: flight
      type(landing_t), intent(in) :: landing
      real(wp), intent(in) :: omega_r  !! W [m/s]
      integer, intent(in) :: line  !! index of the line
      type(crossings_t), intent(inout) :: crossings
      real(wp), intent(in), optional :: until  !! as in record_crossings [s]
      real(wp) :: fraction
      integer :: k

      if (crossings%place(line) > 0) return
      fraction = first_meeting(scene%lines(line), [flight%x, flight%y], [landing%x, landing%y], result%boulder%radius)
      if (present(until)) then
         if (fraction*landing%time > until) return
      end if
      if (.not. fraction <= 1) return
      call find_entry(crossings, line, k)
      crossings%at(k) = crossing(scene, gravity, result, flight, fraction*landing%time, omega_r)
      crossings%at(k)%line = line
   end subroutine record_crossing

   !> Allocate space for the crossings of a number of lines.
   pure subroutine start_crossings(lines, crossings)
      integer, intent(in) :: lines
      type(crossings_t), intent(out) :: crossings

      allocate (crossings%at(min(lines, first_room)), crossings%place(lines))
      crossings%place = 0
   end subroutine start_crossings

   !> Discard all crossings.
   pure subroutine clear_crossings(crossings)
      type(crossings_t), intent(inout) :: crossings

      crossings%place(crossings%at(:crossings%n)%line) = 0
      crossings%n = 0
   end subroutine clear_crossings

   !> Find the index of a line among the crossings, or a new index at their end.
   pure subroutine find_entry(crossings, line, k)
      type(crossings_t), intent(inout) :: crossings
      integer, intent(in) :: line
      integer, intent(out) :: k
      type(crossing_t), allocatable :: longer(:)

      k = crossings%place(line)
      if (k > 0) return
      k = crossings%n + 1
      if (k > size(crossings%at)) then
         allocate (longer(min(2*size(crossings%at), size(crossings%place))))
         longer(:crossings%n) = crossings%at
         call move_alloc(longer, crossings%at)
      end if
      crossings%n = k
      crossings%at(k) = crossing_t(line=line)
      crossings%place(line) = k
   end subroutine find_entry

   !> Store the crossings of a boulder that has ended.
   pure subroutine keep_crossings(crossings, kept)
      type(crossings_t), intent(in) :: crossings
      type(crossings_t), intent(inout) :: kept

      kept%n = crossings%n
      kept%at = crossings%at(:crossings%n)
   end subroutine keep_crossings

   !> Outcome of a boulder at the barrier on a line, as in crossing_t.
   pure integer(i1) function outcome_at(crossings, line) result(outcome)
      type(crossings_t), intent(in) :: crossings
      integer, intent(in) :: line

      outcome = 0
      if (crossings%place(line) > 0) outcome = crossings%at(crossings%place(line))%outcome
   end function outcome_at

   !> State of a boulder at time `t` after the start of a flight.
   !>
   !> The passing height is that of the sphere's centre, as in the paper. A sphere on a slope touches it along the
   !> normal, so its centre is R_b sqrt(1 + |g|**2) = R_b/cos(slope) vertically above the surface, plus the jump height
   !> in flight (theory, chapter 10).
   pure type(crossing_t) function crossing(scene, gravity, result, flight, t, omega_r) result(c)
      type(scene_t), intent(in) :: scene
      real(wp), intent(in) :: gravity  !! gravity along the path [m/s2]
      type(boulder_result_t), intent(in) :: result
      type(flight_t), intent(in) :: flight
      real(wp), intent(in) :: t        !! [s]
      real(wp), intent(in) :: omega_r  !! W [m/s]
      type(patch_t) :: patch
      real(wp) :: u, w, g(2)

      c%crossed = .true.
      c%time = result%time + t
      c%x = flight%x + flight%v(1)*t
      c%y = flight%y + flight%v(2)*t
      c%v = [flight%v(1), flight%v(2), flight%v(3) - gravity*t]
      c%omega = omega_r/result%boulder%radius
      associate (dem => scene%dem)
         call locate(dem, c%x, c%y, patch, u, w)
         c%jump_height = max(0.0_wp, flight%z + t*(flight%v(3) - 0.5_wp*gravity*t) - height(patch, u, w))
         g = gradient(dem, patch, u, w)
         c%passing_height = c%jump_height + result%boulder%radius*steepness_of(g(1), g(2))
      end associate
   end function crossing
end module rockfall_crossings
