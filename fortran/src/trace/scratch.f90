! SPDX-License-Identifier: BSD-3-Clause
!> Work space of a boulder: everything recorded between release and rest.
module rockfall_scratch
   use rockfall_kinds, only: wp, i8
   use rockfall_flight, only: flight_t
   use rockfall_rolling, only: touch_t
   use rockfall_maps, only: visits_t, start_visits
   use rockfall_hit_maps, only: paths_t, find_hits
   use rockfall_tree_maps, only: tree_hits_t
   use rockfall_histogram, only: histograms_t
   use rockfall_scene_type, only: scene_t
   use rockfall_breakage, only: split_t
   use rockfall_outcome, only: boulder_result_t
   use rockfall_record, only: record_t
   use rockfall_crossings, only: crossings_t, clear_crossings
   implicit none
   private
   public :: scratch_t, piece_t, gathered_t, basic, with_lines, with_maps, with_all
   public :: clear_scratch, find_all_hits, count_ground

   !> Level of recording: only the boulder's result; also lines and histograms; also visits of raster cells; also
   !> trajectory vertices, obstacles and the energy balance.
   integer, parameter :: basic = 0, with_lines = 1, with_maps = 2, with_all = 3

   !> Boulder at its release, or fragment at its origin, from which a path starts.
   type :: piece_t
      integer(i8) :: number = 0            !! number from fragment_number
      type(boulder_result_t) :: result     !! result so far
      type(flight_t) :: flight             !! first flight
      real(wp) :: omega_r = 0.0_wp         !! W [m/s]
      type(record_t) :: path               !! path so far
   end type piece_t

   !> Additional records of a boulder that may break: visits with energies, from `merge_visits`.
   type :: gathered_t
      type(visits_t) :: hits
      type(visits_t) :: passing            !! passing heights, from merge_passing
      integer :: stops = 0                 !! number of fragments that came to rest
      integer, allocatable :: stop_cell(:, :)  !! column and row of each of these fragments
   end type gathered_t

   !> Work space of a boulder; components not needed by the scene are not allocated.
   type :: scratch_t
      logical :: cells_requested = .false.       !! maps need visits of cells
      logical :: heights_requested = .false.     !! maps need heights in the visited cells
      logical :: hits_requested = .false.        !! maps need the objects that the boulder would hit
      logical :: passing_requested = .false.     !! maps need passing heights
      type(visits_t) :: visits
      type(paths_t) :: paths                     !! if hits are requested
      type(histograms_t) :: histograms
      integer(i8), allocatable :: by_ground(:)   !! rebounds on each of the scene's grounds
      type(crossings_t), allocatable :: crossings
      integer, allocatable :: felled(:)          !! broken trees
      logical :: tree_hits_requested = .false.   !! maps need hits of trees
      type(tree_hits_t) :: tree_hits
      type(record_t) :: record
      type(touch_t) :: touch                     !! state on ground with an impact table
      ! Only if boulders may break:
      type(piece_t), allocatable :: start        !! piece to be traced
      integer :: room = 1                        !! maximum number of fragments of this piece
      type(piece_t), allocatable :: broken       !! state of the piece when it broke, and its fragments
      type(split_t) :: split
      type(gathered_t), allocatable :: gathered
   end type scratch_t

contains

   !> Clear the work space for the next boulder.
   pure subroutine clear_scratch(scene, level, scratch)
      type(scene_t), intent(in) :: scene
      integer, value :: level  !! basic, ..., with_all
      type(scratch_t), intent(inout) :: scratch

      scratch%record%n = 0
      scratch%touch = touch_t()
      if (level >= with_lines) then
         if (allocated(scratch%crossings)) call clear_crossings(scratch%crossings)
         if (scene%histograms_requested) scratch%histograms%count = 0
      end if
      if (level >= with_maps .and. scratch%cells_requested) call start_visits(scratch%visits)
      scratch%paths%n = 0
      if (level >= with_all) then
         if (allocated(scratch%by_ground)) scratch%by_ground = 0
         if (allocated(scene%forest)) scratch%felled = [integer ::]
         scratch%tree_hits%n = 0
      end if
   end subroutine clear_scratch

   !> Find the objects hit by a boulder on its paths, each once.
   pure subroutine find_all_hits(scene, radius, paths, hits)
      type(scene_t), intent(in) :: scene
      real(wp), intent(in) :: radius  !! R_b [m]
      type(paths_t), intent(in) :: paths
      type(visits_t), intent(inout) :: hits

      call find_hits(hits, scene%dem, paths, 0.5_wp*scene%object_width + radius)
   end subroutine find_all_hits

   !> Count a rebound on a ground.
   pure subroutine count_ground(ground, scratch)
      integer, intent(in) :: ground
      type(scratch_t), intent(inout) :: scratch

      scratch%by_ground(ground) = scratch%by_ground(ground) + 1
   end subroutine count_ground
end module rockfall_scratch
