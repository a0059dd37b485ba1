! SPDX-License-Identifier: BSD-3-Clause
!> Boulders in lanes: results, crossings, maps and histograms are bitwise identical to boulders run one by one.
program test_lanes
   use rockfall_kinds, only: wp, i1, i4, i8
   use rockfall_error, only: error_t
   use rockfall_random, only: random_key, normal_table
   use rockfall_terrain, only: terrain
   use rockfall_line, only: line
   use rockfall_impact, only: impact_set
   use rockfall_direction, only: past_aspect, to_aspect, by_lab
   use rockfall_histogram, only: bins, quantities
   use rockfall_maps, only: maps_t
   use rockfall_scene_type, only: scene_t, goes_in_lanes, one_by_one, narrow_lanes, masked_lanes
   use rockfall_outcome, only: boulder_result_t
   use rockfall_crossings, only: crossing_t, crossings_t
   use rockfall_ensemble, only: run_boulders
   use check_m, only: check, finish
   implicit none

   integer, parameter :: n = 80, boulders = 500
   real(wp), parameter :: cell = 5.0_wp
   real(wp), target :: z(n, n)
   integer(i4), target :: passages(n, n)

   !> Complete results of a run.
   type :: run_t
      type(boulder_result_t) :: results(boulders)
      type(crossings_t) :: crossings(boulders)
      integer(i4) :: passages(n, n)
      integer(i8) :: histogram(bins, quantities)
   end type run_t

   call random_init(.true., .false.)
   call test_same()
   call test_grounds()
   call test_which_go()
   call finish()

contains

   !> Rough slope of 0.8 that falls to the east, with a column of pits and a flat strip.
   subroutine make_scene(scene)
      type(scene_t), intent(out) :: scene
      type(error_t), allocatable :: error
      real(wp) :: covariance(9, 9)
      integer :: i, k

      call random_number(z)
      do i = 1, n
         z(i, :) = 2*z(i, :) - 0.8_wp*cell*i
      end do
      z(30, :) = z(31, :) - 3
      z(50:52, :) = -160
      scene%dem = terrain(0.0_wp, 0.0_wp, cell, z8=z)
      scene%key = random_key(11_i8)
      scene%table = normal_table()
      scene%surface%sizes = reshape([0.25_wp], [1, 1])
      scene%volumes%mean = 0.8_wp
      scene%release%x = [20.0_wp]
      scene%release%y = [200.0_wp]
      scene%release%boulders_per_source = boulders
      scene%release%drop_height = 2
      scene%histograms_requested = .true.
      scene%lines = [line([100.0_wp, 100.0_wp], [5.0_wp, 390.0_wp]), line([160.0_wp, 220.0_wp], [5.0_wp, 390.0_wp])]
      covariance = 0
      do k = 1, 9
         covariance(k, k) = 0.02_wp
      end do
      do k = 1, size(scene%sets)
         call impact_set([0.7_wp, 0.0_wp, 0.1_wp, 0.1_wp, -0.4_wp, 0.0_wp, 0.3_wp, 0.0_wp, 0.4_wp], covariance, &
                         scene%sets(k), error)
         call check("a set", .not. allocated(error))
      end do
   end subroutine make_scene

   !> Run a scene in one of the execution modes.
   subroutine run_by(scene, lanes, run)
      type(scene_t), intent(inout) :: scene
      integer, intent(in) :: lanes
      type(run_t), intent(out) :: run
      type(maps_t) :: maps
      integer(i8), allocatable :: by_ground(:)

      scene%lanes = lanes
      passages = 0
      maps%passages => passages
      run%histogram = 0
      allocate (by_ground(merge(2, 0, allocated(scene%grounds))), source=0_i8)
      call run_boulders(scene, 1_i8, 1_i8, 1, run%results, run%crossings, [maps], run%histogram, by_ground)
      run%passages = passages
   end subroutine run_by

   subroutine compare(scene, name)
      type(scene_t), intent(inout) :: scene
      character(len=*), intent(in) :: name
      type(run_t), allocatable :: alone, together
      integer :: lanes

      allocate (alone, together)
      call run_by(scene, one_by_one, alone)
      call check(name//": many contacts", sum(alone%results%rebounds) > 10*boulders)
      call check(name//": lines crossed", any(alone%crossings%n > 0))
      call check(name//": some redrawn", any(alone%results%redrawn > 0))
      do lanes = narrow_lanes, masked_lanes
         call run_by(scene, lanes, together)
         call check(name//": results", all(same_result(together%results, alone%results)))
         call check(name//": crossings", all(same_crossings(together%crossings, alone%crossings)))
         call check(name//": maps", all(together%passages == alone%passages))
         call check(name//": histograms", all(together%histogram == alone%histogram))
      end do
   end subroutine compare

   elemental logical function same_result(a, b) result(same)
      type(boulder_result_t), intent(in) :: a, b

      same = all([a%status, a%impacts, a%source, a%stop_cell, a%rebounds, a%redrawn, a%forced, a%out_of_range] &
                 == [b%status, b%impacts, b%source, b%stop_cell, b%rebounds, b%redrawn, b%forced, b%out_of_range]) &
             .and. all([a%start, a%stop, a%path_length, a%time, a%speed_max, a%jump_height_max, a%boulder%volume] &
                       == [b%start, b%stop, b%path_length, b%time, b%speed_max, b%jump_height_max, b%boulder%volume])
   end function same_result

   elemental logical function same_crossings(a, b) result(same)
      type(crossings_t), intent(in) :: a, b

      same = a%n == b%n
      if (same) same = all(same_crossing(a%at, b%at))
   end function same_crossings

   elemental logical function same_crossing(a, b) result(same)
      type(crossing_t), intent(in) :: a, b

      same = a%line == b%line .and. (a%crossed .eqv. b%crossed)
      if (a%crossed) same = same .and. all([a%x, a%y, a%time, a%v, a%omega, a%jump_height, a%passing_height] &
                                           == [b%x, b%y, b%time, b%v, b%omega, b%jump_height, b%passing_height])
   end function same_crossing

   !> Results are equal, also if slow boulders roll, and if few contacts are allowed.
   subroutine test_same()
      type(scene_t) :: scene

      call make_scene(scene)
      call compare(scene, "a slope")
      scene%rest_slope = 0.3_wp
      scene%stop_speed = 3
      call compare(scene, "with rolls")
      scene%max_impacts = 25
      call compare(scene, "with a limit")
      scene%turning = to_aspect
      call compare(scene, "turned to the aspect")
   end subroutine test_same

   !> Two grounds with different impact sets, each on half of the slope.
   subroutine test_grounds()
      type(scene_t) :: scene
      integer(i1), allocatable, target :: ground(:, :)
      integer :: k

      call make_scene(scene)
      allocate (scene%grounds(2), ground(n, n))
      ground(:, :n/2) = 1
      ground(:, n/2 + 1:) = 2
      scene%surface%cell_ground => ground
      do k = 1, 2
         scene%grounds(k)%sets = scene%sets
         scene%grounds(k)%rest_slope = 0.2_wp*k
      end do
      scene%grounds(2)%sets%mean(1) = 0.6_wp
      call compare(scene, "grounds")
   end subroutine test_grounds

   !> Boulders run in lanes if they do not break and do not turn as in the laboratory.
   subroutine test_which_go()
      type(scene_t) :: scene

      scene%turning = past_aspect
      call check("in lanes", goes_in_lanes(scene))
      scene%turning = by_lab
      call check("not turned by the laboratory", .not. goes_in_lanes(scene))
      scene%turning = past_aspect
      allocate (scene%breakage)
      call check("nor those that may break", .not. goes_in_lanes(scene))
   end subroutine test_which_go
end program test_lanes
