! SPDX-License-Identifier: BSD-3-Clause
!> Contacts on planes: absorbing rocks, the ground of a cell, rest or roll, and the maximum number of contacts.
program test_contact
   use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_positive_inf
   use rockfall_kinds, only: wp, i1, i8
   use rockfall_random, only: random_key
   use rockfall_terrain, only: terrain, locate, height
   use rockfall_flight, only: landing_t
   use rockfall_rolling, only: roll_t
   use rockfall_scene_type, only: scene_t, n_grounds, is_slow
   use rockfall_outcome, only: boulder_result_t, stopped, absorbed, impact_limit
   use rockfall_scratch, only: with_all
   use rockfall_block_shape, only: shape_mix
   use rockfall_contact, only: find_ground, find_impact_set, close_impact, rest_or_roll
   use check_m, only: check, check_close, finish
   implicit none

   integer, parameter :: n = 20
   real(wp), parameter :: cell = 2.0_wp, slope = 0.5_wp
   real(wp), target :: z(n, n)
   integer(i1), target :: zone(n, n), ground(n, n)
   type(scene_t) :: scene
   integer :: k

   z = spread([(-slope*cell*k, k=1, n)], 2, n)
   scene%dem = terrain(0.0_wp, 0.0_wp, cell, z8=z)
   scene%key = random_key(1_i8)
   call test_ground()
   call test_class()
   call test_limit()
   call test_rest()
   call finish()

contains

   !> Rocks of 0.2 m in the west, then a river, and no rocks in the east; two grounds, in the north and in the south.
   subroutine test_ground()
      real(wp), parameter :: u = 0.5_wp  ! any value: the rocks have one size
      real(wp) :: radius, obstacle
      integer :: number, status

      scene%surface%sizes = reshape([0.2_wp, ieee_value(1.0_wp, ieee_positive_inf), 0.0_wp], [1, 3])
      zone(:8, :) = 1
      zone(9:14, :) = 2
      zone(15:, :) = 3
      scene%surface%zone1 => zone
      status = 0
      call find_ground(scene, u, 0, [3, 5], with_all, number, radius, obstacle, status)
      call check_close("rocks", radius, 0.2_wp, 1.0e-15_wp)
      call check("no ground of its own", number == 0 .and. status == 0)
      call find_ground(scene, u, 0, [9, 5], with_all, number, radius, obstacle, status)
      call check("the river absorbs", status == absorbed)
      allocate (scene%grounds(2))
      ground(:, :10) = 1
      ground(:, 11:) = 2
      scene%surface%cell_ground => ground
      status = 0
      call find_ground(scene, u, 0, [3, 12], with_all, number, radius, obstacle, status)
      call check("its ground", number == 2 .and. status == 0)
      call check_close("obstacles", obstacle, 0.2_wp/scene%surface%size_to_radius, 1.0e-15_wp)
      scene%shapes = shape_mix([0.5_wp, 0.5_wp, 0.0_wp])
      call find_ground(scene, u, 2, [3, 12], with_all, number, radius, obstacle, status)
      call check("whose table serves all shapes", number == 2)
      scene%shapes%ground = reshape([1, 2, 1, 1, 1, 2], [2, 3])
      call find_ground(scene, u, 2, [3, 12], with_all, number, radius, obstacle, status)
      call check("or the ground that stands in for it by shape", number == 1 .and. status == 0)
      call check("grounds of the cells", n_grounds(scene) == 2)
      deallocate (scene%shapes)
      call find_ground(scene, u, 0, [16, 5], with_all, number, radius, obstacle, status)
      call check("ground without rocks has a radius", radius > 0 .and. radius < 1.0e-6_wp)
      deallocate (scene%grounds)
   end subroutine test_ground

   subroutine test_class()
      real(wp), parameter :: u = 0.1_wp
      integer :: class
      logical :: outside

      call find_impact_set(scene, 2.3_wp, u, class, outside)
      call check("the nearest set", class == 2 .and. .not. outside)
      scene%between_ratios = .true.
      call find_impact_set(scene, 2.3_wp, u, class, outside)
      call check("or the one above", class == 3)
      scene%between_ratios = .false.
      call find_impact_set(scene, 9.0_wp, u, class, outside)
      call check("the last one, outside", class == size(scene%sets) .and. outside)
   end subroutine test_class

   subroutine test_limit()
      type(boulder_result_t) :: result

      scene%max_impacts = 3
      result%impacts = 2
      call close_impact(scene, 9.0_wp, .true., result)
      call check("one more", result%status == 0)
      result%impacts = 3
      call close_impact(scene, 4.0_wp, .false., result)
      call check("a slow one is not at its limit yet", result%status == 0)
      call close_impact(scene, 4.0_wp, .true., result)
      call check("the last", result%status == impact_limit)
      call check_close("square of the maximum speed", result%speed_max, 9.0_wp, 1.0e-15_wp)
      scene%stop_speed = 2
      call check("slow", is_slow(scene, 3.99_wp) .and. .not. is_slow(scene, 4.0_wp))
   end subroutine test_limit

   !> On a plane of slope 0.5, a boulder rests if the rest angle is steeper, and rolls otherwise.
   subroutine test_rest()
      type(boulder_result_t) :: result
      type(landing_t) :: landing
      type(roll_t) :: roll
      real(wp) :: u, w

      scene%max_impacts = 100
      result%boulder%radius = 0.4_wp
      landing%contact = .true.
      landing%x = 11
      landing%y = 13
      call locate(scene%dem, landing%x, landing%y, landing%patch, landing%u, landing%w)
      landing%z = height(landing%patch, landing%u, landing%w)
      scene%rest_slope = slope*1.01_wp
      call rest_or_roll(scene, 0, landing, 0.01_wp, 0.0_wp, result, roll)
      call check("rests", result%status == stopped .and. .not. roll%rolls)
      result%status = 0
      scene%rest_slope = slope*0.99_wp
      call rest_or_roll(scene, 0, landing, 0.01_wp, 0.0_wp, result, roll)
      call check("rolls", result%status == 0 .and. roll%rolls)
      u = roll%landing%x - landing%x
      w = roll%landing%z - landing%z
      call check_close("by its radius, down the plane", sqrt(u*u + w*w), 0.4_wp, 1.0e-12_wp)
      allocate (scene%grounds(2))
      scene%grounds(2)%rest_slope = slope*1.01_wp
      call rest_or_roll(scene, 2, landing, 0.01_wp, 0.0_wp, result, roll)
      call check("rests by the angle of its ground", result%status == stopped)
      result%status = 0
      result%impacts = 100
      scene%grounds(2)%rest_slope = 0
      call rest_or_roll(scene, 2, landing, 0.01_wp, 0.0_wp, result, roll)
      call check("nor rolls beyond its limit", result%status == impact_limit)
   end subroutine test_rest
end program test_contact
