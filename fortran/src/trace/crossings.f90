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
   public :: crossing_t, crossings_t, crossing, record_crossings, keep_crossings, outcome_at

   !> First crossing of an evaluation line.
   type :: crossing_t
      logical :: crossed = .false.
      integer(i1) :: outcome = 0       !! outcome at the barrier (rockfall_barrier); 0: not hit
      real(wp) :: x = 0, y = 0, time = 0  !! local coordinates [m], since release [s]
      real(wp) :: v(3) = 0, omega = 0  !! [m/s], [rad/s]
      real(wp) :: jump_height = 0      !! lowest point above the surface [m]
      real(wp) :: passing_height = 0   !! centre of the sphere above the surface, vertical [m]
      integer :: line = 0              !! its index; in crossings_t only
      integer :: fragments = 0         !! of a boulder that may break: those that crossed, and
      type(boulder_t) :: fragment      !! the one that the rest is of
   end type crossing_t

   !> Crossings of a boulder. Of thousands of lines it crosses few.
   type :: crossings_t
      type(crossing_t), allocatable :: at(:)  !! by increasing line
   end type crossings_t

contains

   !> Record the first crossings of lines along a flight, up to a time.
   pure subroutine record_crossings(scene, gravity, result, flight, landing, omega_r, crossings, until)
      type(scene_t), intent(in) :: scene
      real(wp), intent(in) :: gravity  !! of the path [m/s2]
      type(boulder_result_t), intent(in) :: result
      type(flight_t), intent(in) :: flight
      type(landing_t), intent(in) :: landing
      real(wp), intent(in) :: omega_r  !! W [m/s]
      type(crossing_t), intent(inout) :: crossings(:)
      real(wp), intent(in), optional :: until  !! since the start of the flight [s]
      integer :: columns(2), rows(2), k, j

      if (.not. allocated(scene%line_index)) then
         do k = 1, size(scene%lines)
            call record_crossing(scene, gravity, result, flight, landing, omega_r, k, crossings(k), until)
         end do
         return
      end if
      associate (index => scene%line_index)
         call buckets_of(index, [flight%x, flight%y], [landing%x, landing%y], columns, rows)
         do j = (rows(1) - 1)*index%n(1), (rows(2) - 1)*index%n(1), index%n(1)
            do k = index%first(j + columns(1)), index%first(j + columns(2) + 1) - 1
               call record_crossing(scene, gravity, result, flight, landing, omega_r, index%line(k), &
                                    crossings(index%line(k)), until)
            end do
         end do
      end associate
   end subroutine record_crossings

   !> Record the first crossing of a line, unless an earlier flight crossed it.
   pure subroutine record_crossing(scene, gravity, result, flight, landing, omega_r, line, crossed, until)
      type(scene_t), intent(in) :: scene
      real(wp), intent(in) :: gravity
      type(boulder_result_t), intent(in) :: result
      type(flight_t), intent(in) :: flight
      type(landing_t), intent(in) :: landing
      real(wp), intent(in) :: omega_r
      integer, intent(in) :: line  !! its index
      type(crossing_t), intent(inout) :: crossed
      real(wp), intent(in), optional :: until
      real(wp) :: fraction

      if (crossed%crossed) return
      fraction = first_meeting(scene%lines(line), [flight%x, flight%y], [landing%x, landing%y], result%boulder%radius)
      if (present(until)) then
         if (fraction*landing%time > until) return
      end if
      if (fraction <= 1) crossed = crossing(scene, gravity, result, flight, fraction*landing%time, omega_r)
   end subroutine record_crossing

   !> Keep the crossings of a boulder that has ended, of those at all lines.
   pure subroutine keep_crossings(crossings, kept)
      type(crossing_t), intent(in) :: crossings(:)
      type(crossings_t), intent(inout) :: kept
      integer :: n, k

      n = count(is_kept(crossings))
      if (allocated(kept%at)) deallocate (kept%at)
      allocate (kept%at(n))
      n = 0
      do k = 1, size(crossings)
         if (.not. is_kept(crossings(k))) cycle
         n = n + 1
         kept%at(n) = crossings(k)
         kept%at(n)%line = k
      end do
   end subroutine keep_crossings

   elemental logical function is_kept(crossing)
      type(crossing_t), intent(in) :: crossing

      is_kept = crossing%crossed .or. crossing%outcome /= 0
   end function is_kept

   !> Outcome of a boulder at the barrier on a line, as in crossing_t.
   pure integer(i1) function outcome_at(crossings, line) result(outcome)
      type(crossings_t), intent(in) :: crossings
      integer, intent(in) :: line
      integer :: k

      outcome = 0
      do k = 1, size(crossings%at)
         if (crossings%at(k)%line == line) outcome = crossings%at(k)%outcome
      end do
   end function outcome_at

   !> State of a boulder `t` after the start of a flight.
   !>
   !> The passing height is that of the centre of the sphere, as in the paper. A sphere on a slope touches it along the
   !> normal, so its centre is R_b sqrt(1 + |g|**2) = R_b/cos(slope) vertically above the surface, plus the jump height
   !> in flight (theory, chapter 10).
   pure type(crossing_t) function crossing(scene, gravity, result, flight, t, omega_r) result(c)
      type(scene_t), intent(in) :: scene
      real(wp), intent(in) :: gravity  !! of the path [m/s2]
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
