! SPDX-License-Identifier: BSD-3-Clause
!> Values that a run can have, and messages for other values.
program test_value_rules
   use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan, ieee_positive_inf
   use rockfall_kinds, only: wp
   use rockfall_text, only: real_text
   use rockfall_grid, only: grid_t
   use rockfall_value_rules, only: value_fault
   use check_m, only: check, finish
   implicit none

   type(grid_t), parameter :: grid = grid_t(100.0_wp, 200.0_wp, 2.0_wp, 10, 20)
   real(wp) :: nan, infinity

   nan = ieee_value(nan, ieee_quiet_nan)
   infinity = ieee_value(infinity, ieee_positive_inf)
   call check("volumes", value_fault("volume", [1e-3_wp, 2.0_wp]) == "")
   call check("no volume", value_fault("volume", [1.0_wp, 0.0_wp]) == "volume = 0: must be > 0")
   call check("a length", value_fault("path_length", [0.0_wp]) == "" &
              .and. value_fault("path_length", [-0.5_wp]) == "path_length = -0.5: must be >= 0")
   call check("a status", value_fault("status", [1.0_wp, 7.0_wp]) == "" &
              .and. value_fault("status", [9.0_wp]) == "status = 9: must be 1 to 7")
   call check("an elevation", value_fault("stop_z", [-400.0_wp]) == "" .and. value_fault("stop_z", [nan]) /= "" &
              .and. value_fault("stop_z", [infinity]) == "stop_z: must be a number")
   call check("the edges of a terrain", value_fault("stop_x", [100.0_wp, 120.0_wp], grid) == "" &
              .and. value_fault("stop_y", [160.0_wp, 200.0_wp], grid) == "")
   call check("beyond them", value_fault("stop_y", [159.0_wp], grid) &
              == "stop_y = 159: must be 160 to 200, on the terrain" .and. value_fault("stop_y", [159.0_wp]) == "")
   call check("a crossing", value_fault("crossing_time", [0.0_wp]) == "" &
              .and. value_fault("crossing_time", [-1.0_wp]) == "crossing_time = -1: must be >= 0" &
              .and. value_fault("crossing_omega", [-1.0_wp]) == "" .and. value_fault("crossing_omega", [nan]) /= "")
   call check("fragments at a line", value_fault("crossing_fragments", [0.0_wp]) /= "" &
              .and. value_fault("crossing_volume", [0.0_wp]) /= "")
   call check("numbers as text", real_text(600000.0_wp, 10) == "600000" .and. real_text(1e30_wp, 6) == "1e30" &
              .and. real_text(-1e-9_wp, 6) == "-1e-9" .and. real_text(0.1_wp, 6) == "0.1" &
              .and. real_text(0.0_wp, 6) == "0" .and. real_text(123456.5_wp, 10) == "123456.5")
   call finish()
end program test_value_rules
