! SPDX-License-Identifier: BSD-3-Clause
!> Which key of two cases differs: their values, not how they are written.
program test_case_file
   use rockfall_same_run, only: differing_key
   use check_m, only: check, finish
   implicit none

   character(len=*), parameter :: case = "&case boulders = 3 / &terrain dem = 'a.tif' / &surface &
      &uniform_mean_radius = 0.5 / &boulder volume_mean = 1.0 / &release x = 1.0, y = 2.0 / &
      &&line name = 'a', x = 0, 1, y = 0, 1 /"

   call check("the same values, written otherwise", differs( &
      "! again"//achar(10)//"&terrain dem = ""a.tif"" / &case threads = 3 seed = 1, boulders = 03 / &surface &
      &uniform_mean_radius = 5e-1, method = 'B' / &boulder volume_mean = 1 / &release x = 1, y = 2 / &line name = 'a', &
      &x = 0, 1, y = 0.0, 1 /") == "")
   call check("a real", differs(changed("0.5", "0.6")) == "&surface uniform_mean_radius")
   call check("a text", differs(changed("a.tif", "b.tif")) == "&terrain dem")
   call check("a list", differs(changed("y = 0, 1", "y = 0, 2")) == "&line y")
   call check("an absent key", differs(changed("y = 2.0", "y = 2.0, by_area = .false., drop_height = 1")) &
              == "&release drop_height")
   call check("another line", differs(case//" &line name = 'b', x = 0, 1, y = 0, 1 /") == "&line name")
   call check("no case", differs("&case /") == "&case" .and. differs("") == "&case" .and. differs("(") == "&case")
   call check("what a scene file holds", differing_key(case, changed("x = 1.0", "x = 1.5"), .true.) == "&release x")
   call check("what it does not", differing_key(case, changed("y = 2.0", "y = 2.0, velocity = 3*1.0"), .true.) == "" &
              .and. differing_key(case, changed("boulders = 3", "boulders = 4, seed = 9"), .true.) == "")
   call finish()

contains

   function differs(other) result(key)
      character(len=*), intent(in) :: other
      character(len=:), allocatable :: key

      key = differing_key(case, other, .false.)
   end function differs

   !> The case with one word for another.
   function changed(old, new) result(text)
      character(len=*), intent(in) :: old, new
      character(len=:), allocatable :: text
      integer :: at

      at = index(case, old)
      text = case(:at - 1)//new//case(at + len(old):)
   end function changed
end program test_case_file
