! SPDX-License-Identifier: BSD-3-Clause
!> Names suggested for a wrong name.
program test_text
   use rockfall_text, only: nearest_names
   use check_m, only: check, finish
   implicit none

   character(len=*), parameter :: names(*) = [character(len=8) :: "passages", "deposits", "speed", "energy"]

   call check("a letter is missing", all(nearest_names("passage", names, 1) == ["passages"]))
   call check("capitals do not matter", all(nearest_names("SPEDE ", names, 1) == ["speed   "]))
   call check("the nearest first", all(nearest_names("energies", names, 4) &
                                       == [character(len=8) :: "energy", "passages", "deposits", "speed"]))
   call check("of those as near the first", all(nearest_names("", names, 2) == [character(len=8) :: "speed", "energy"]))
   call finish()
end program test_text
