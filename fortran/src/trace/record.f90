! SPDX-License-Identifier: BSD-3-Clause
!> Recorded trajectory of a boulder: its vertices, and the motion from each vertex to the next.
module rockfall_record
   use rockfall_kinds, only: wp
   implicit none
   private
   public :: record_t, vertex_t, record_vertex, start_ground_leg, end_record, stored_part, store_path
   public :: no_leg, flight_leg, ground_leg, rest_leg

   !> Motion from a vertex to the next; no_leg at the end; the others in the order of rockfall_variables.
   integer, parameter :: no_leg = 0, flight_leg = 1, ground_leg = 2, rest_leg = 3

   !> Vertex of a trajectory: release, contact, obstacle hit, or end; on the ground also a point where the path enters
   !> another patch, and where the boulder waits.
   type :: vertex_t
      real(wp) :: x = 0, y = 0, z = 0, time = 0  !! local coordinates [m]; time since release [s]
      real(wp) :: v(3) = 0                   !! velocity after the vertex [m/s]
      real(wp) :: v_in(3) = 0, v_out(3) = 0  !! V_t, V_n, W before and after; 0 without a rebound [m/s]
      real(wp) :: ratio = 0            !! R_b/R_m; 0 without a rebound, -1 after a classical one
      integer :: leg = flight_leg      !! motion to the next vertex
   end type vertex_t

   !> Vertices of a trajectory, as many as fit.
   type :: record_t
      type(vertex_t), allocatable :: vertex(:)  !! allocated by the caller if it needs the trajectory
      integer :: n = 0                          !! number of vertices, which may exceed size(vertex)
   end type record_t

contains

   !> Append a vertex to the record, if one is kept. Counting continues when it is full, to report the size needed.
   pure subroutine record_vertex(record, vertex)
      type(record_t), intent(inout) :: record
      type(vertex_t), intent(in) :: vertex

      if (.not. allocated(record%vertex)) return
      record%n = record%n + 1
      if (record%n <= size(record%vertex)) record%vertex(record%n) = vertex
   end subroutine record_vertex

   !> Set the velocity at the last vertex to the velocity on the ground leg that starts there.
   pure subroutine start_ground_leg(record, v, leg)
      type(record_t), intent(inout) :: record
      real(wp), intent(in) :: v(3)  !! [m/s]
      integer, intent(in) :: leg    !! ground_leg or rest_leg

      if (.not. allocated(record%vertex)) return
      if (record%n > size(record%vertex)) return
      record%vertex(record%n)%v = v
      record%vertex(record%n)%leg = leg
   end subroutine start_ground_leg

   !> Mark the last vertex as the end of motion.
   pure subroutine end_record(record)
      type(record_t), intent(inout) :: record

      if (.not. allocated(record%vertex)) return
      if (record%n <= size(record%vertex)) record%vertex(record%n)%leg = no_leg
   end subroutine end_record

   !> Vertices that were stored, with the number of all vertices.
   pure type(record_t) function stored_part(record)
      type(record_t), intent(in) :: record

      stored_part%n = record%n
      if (allocated(record%vertex)) stored_part%vertex = record%vertex(:min(record%n, size(record%vertex)))
   end function stored_part

   !> Start a record with the path so far. No effect without a record.
   pure subroutine store_path(path, record)
      type(record_t), intent(in) :: path
      type(record_t), intent(inout) :: record

      if (.not. allocated(record%vertex)) return
      if (allocated(path%vertex)) record%vertex(:size(path%vertex)) = path%vertex
      record%n = path%n
   end subroutine store_path
end module rockfall_record
