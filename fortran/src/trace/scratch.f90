! SPDX-License-Identifier: BSD-3-Clause
!> Work space of a boulder: everything recorded between release and rest.
module rockfall_scratch
   use rockfall_kinds, only: wp, i8
   use rockfall_flight, only: flight_t, span_t
   use rockfall_boulder, only: inertia_factor
   use rockfall_rolling, only: touch_t
   use rockfall_maps, only: visits_t, start_visits, visit_path
   use rockfall_travel_maps, only: time_visits
   use rockfall_hit_maps, only: find_hits
   use rockfall_tree_maps, only: tree_hits_t
   use rockfall_histogram, only: histograms_t
   use rockfall_scene_type, only: scene_t
   use rockfall_breakage, only: split_t
   use rockfall_outcome, only: boulder_result_t
   use rockfall_crossings, only: crossings_t, clear_crossings
   implicit none
   private
   public :: scratch_t, contact_t, piece_t, gathered_t, basic, with_lines, with_maps, with_all
   public :: clear_scratch, visit_cells, count_ground, record_vertex, start_ground_leg, end_record
   public :: no_leg, flight_leg, ground_leg, rest_leg

   !> Level of recording, in addition to the boulder's result: nothing; lines and histograms; also visits of raster
   !> cells; also trajectory vertices, obstacles and the energy balance.
   integer, parameter :: basic = 0, with_lines = 1, with_maps = 2, with_all = 3

   !> Motion from a recorded vertex to the next: none at the end; otherwise in the order of rockfall_variables.
   integer, parameter :: no_leg = 0, flight_leg = 1, ground_leg = 2, rest_leg = 3

   !> Vertex of a recorded trajectory: the release, each contact, each obstacle hit, the end; also where a leg on the
   !> ground meets the next patch of the terrain, and where the boulder waits.
   type :: contact_t
      real(wp) :: x = 0, y = 0, z = 0, time = 0  !! local coordinates [m], since release [s]
      real(wp) :: v(3) = 0                   !! velocity after it [m/s]
      real(wp) :: v_in(3) = 0, v_out(3) = 0  !! V_t, V_n, W before and after; 0 without a rebound [m/s]
      real(wp) :: ratio = 0            !! R_b/R_m; 0 without a rebound
      integer :: leg = flight_leg      !! to the next vertex
   end type contact_t

   !> Boulder at its release, or fragment where its boulder broke: start of a path.
   type :: piece_t
      integer(i8) :: number = 0            !! as of fragment_number
      type(boulder_result_t) :: result     !! so far
      type(flight_t) :: flight             !! the first
      real(wp) :: omega_r = 0.0_wp         !! W [m/s]
      integer :: recorded = 0              !! vertices of the path that led here
      type(contact_t), allocatable :: path(:)  !! these, as far as they are kept
   end type piece_t

   !> Record of a boulder that may break, in addition to that of others: `visits` and `hits` are then with energies,
   !> as of `merge_visits`.
   type :: gathered_t
      type(visits_t) :: passing            !! as of merge_passing
      integer :: stops = 0                 !! fragments that came to rest
      integer, allocatable :: stop_cell(:, :)  !! where: column, row
   end type gathered_t

   !> Work space of a boulder; components not needed by the scene are not allocated.
   type :: scratch_t
      logical :: cells_requested = .false.       !! maps need visits of cells
      logical :: heights_requested = .false.     !! maps need heights in these cells
      logical :: hits_requested = .false.        !! maps need the objects that it would hit
      logical :: passing_requested = .false.     !! maps need passing heights
      type(visits_t) :: visits, hits
      type(histograms_t) :: histograms
      integer(i8), allocatable :: by_ground(:)   !! rebounds on each of the scene's grounds
      type(crossings_t), allocatable :: crossings
      integer, allocatable :: felled(:)          !! broken trees
      logical :: tree_hits_requested = .false.   !! maps need hits of trees
      type(tree_hits_t) :: tree_hits
      type(contact_t), allocatable :: record(:)  !! allocated by the caller if it needs the trajectory
      integer :: recorded = 0                    !! number of vertices, possibly above size(record)
      type(touch_t) :: touch                     !! state on the ground of a table
      ! Only where boulders may break:
      type(piece_t), allocatable :: start        !! the piece to be traced,
      integer :: room = 1                        !! the fragments that it may become,
      type(piece_t), allocatable :: broken       !! and its last state, if it broke, with its fragments
      type(split_t) :: split
      type(gathered_t), allocatable :: gathered
   end type scratch_t

contains

   !> Clear the work space for the next boulder.
   pure subroutine clear_scratch(scene, level, scratch)
      type(scene_t), intent(in) :: scene
      integer, value :: level  !! basic, ..., with_all
      type(scratch_t), intent(inout) :: scratch

      scratch%recorded = 0
      scratch%touch = touch_t()
      if (level >= with_lines) then
         if (allocated(scratch%crossings)) call clear_crossings(scratch%crossings)
         if (scene%histograms_requested) scratch%histograms%count = 0
      end if
      if (level >= with_maps .and. scratch%cells_requested) call start_visits(scratch%visits)
      if (level >= with_maps .and. scratch%hits_requested) call start_visits(scratch%hits)
      if (level >= with_all) then
         if (allocated(scratch%by_ground)) scratch%by_ground = 0
         if (allocated(scene%forest)) scratch%felled = [integer ::]
         scratch%tree_hits%n = 0
      end if
   end subroutine clear_scratch

   !> Record the raster cells under a flight, or along a roll, which is a path without gravity.
   pure subroutine visit_cells(scene, gravity, flight, omega_r, radius, start_time, time, spans, scratch)
      type(scene_t), intent(in) :: scene
      real(wp), intent(in) :: gravity  !! of the path [m/s2]
      type(flight_t), intent(in) :: flight
      real(wp), intent(in) :: omega_r  !! W [m/s]
      real(wp), intent(in) :: radius   !! of the boulder [m]
      real(wp), intent(in) :: start_time  !! since the release [s]
      real(wp), intent(in) :: time     !! of the flight [s]
      type(span_t), intent(in), contiguous :: spans(:)  !! spans of the flight
      type(scratch_t), intent(inout) :: scratch

      associate (visits => scratch%visits, spin => inertia_factor*omega_r**2)
         if (scratch%heights_requested) then
            call visit_path(visits, scene%dem, gravity, flight, time, spin, spans)
         else
            call visit_path(visits, scene%dem, gravity, flight, time, spin)
         end if
         if (allocated(visits%time)) &
            call time_visits(visits, scene%dem, [flight%x, flight%y], flight%v(:2), start_time, time)
         if (scratch%hits_requested) &
            call find_hits(scratch%hits, scene%dem, gravity, flight, time, spin, 0.5_wp*scene%object_width + radius)
      end associate
   end subroutine visit_cells

   !> Count a rebound on a ground.
   pure subroutine count_ground(ground, scratch)
      integer, intent(in) :: ground
      type(scratch_t), intent(inout) :: scratch

      scratch%by_ground(ground) = scratch%by_ground(ground) + 1
   end subroutine count_ground

   !> Append a vertex to the record, if any; keeps counting when it is full, so that the caller learns the size needed.
   pure subroutine record_vertex(scratch, vertex)
      type(scratch_t), intent(inout) :: scratch
      type(contact_t), intent(in) :: vertex

      if (.not. allocated(scratch%record)) return
      scratch%recorded = scratch%recorded + 1
      if (scratch%recorded <= size(scratch%record)) scratch%record(scratch%recorded) = vertex
   end subroutine record_vertex

   !> Set the velocity at the last vertex to that of the leg on the ground that starts there.
   pure subroutine start_ground_leg(scratch, v, leg)
      type(scratch_t), intent(inout) :: scratch
      real(wp), intent(in) :: v(3)  !! [m/s]
      integer, intent(in) :: leg    !! ground_leg or rest_leg

      if (.not. allocated(scratch%record)) return
      if (scratch%recorded > size(scratch%record)) return
      scratch%record(scratch%recorded)%v = v
      scratch%record(scratch%recorded)%leg = leg
   end subroutine start_ground_leg

   !> Note that no motion follows the last vertex.
   pure subroutine end_record(scratch)
      type(scratch_t), intent(inout) :: scratch

      if (.not. allocated(scratch%record)) return
      if (scratch%recorded <= size(scratch%record)) scratch%record(scratch%recorded)%leg = no_leg
   end subroutine end_record
end module rockfall_scratch
