! SPDX-License-Identifier: BSD-3-Clause
!> Differences between runs; cases are compared by values, not by notation.
program test_same_run
   use rockfall_kinds, only: i8
   use rockfall_same_run, only: identity_t, difference, differing_key, keys_of
   use check_m, only: check, finish
   implicit none

   character(len=*), parameter :: case = "&case boulders = 3 / &terrain dem = 'a.tif' / &surface &
      &uniform_mean_radius = 0.5 / &boulder volume_mean = 1.0 / &release x = 1.0, y = 2.0 / &
      &&line name = 'a', x = 0, 1, y = 0, 1 /"

   type(identity_t) :: ours, theirs

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
   call check("what a scene file holds", held_key(changed("x = 1.0", "x = 1.5")) == "&release x")
   call check("what it does not", held_key(changed("y = 2.0", "y = 2.0, velocity = 3*1.0")) == "" &
              .and. held_key(changed("boulders = 3", "boulders = 4, seed = 9")) == "")
   call new_run(ours)
   call new_run(theirs)
   theirs%last = 7
   call check("a part that begins a run", difference(ours, theirs) == "")
   theirs%last = 11
   call check("boulders past its end", difference(ours, theirs) == "boulders")
   call new_run(theirs)
   theirs%first = 2
   call check("boulders that do not begin it", difference(ours, theirs) == "boulders")
   call new_run(theirs)
   theirs%read = '{"dem": "ab", "sets": "ce"}'
   call check("a checksum", difference(ours, theirs) == "sets")
   theirs%read = '{"DEM": "ab", "sets": "cd"}'
   call check("the name of an input", difference(ours, theirs) == "dem")
   theirs%read = '{"dem": "ab", "sets": "cd", "zones": "ef"}'
   call check("one input more", difference(ours, theirs) == "zones")
   call check("one fewer", difference(theirs, ours) == "zones")
   theirs%read = "{}"
   call check("none", difference(ours, theirs) == "dem" .and. difference(theirs, ours) == "dem")
   theirs%read = "damaged"
   call check("no checksums", difference(ours, theirs) /= "" .and. difference(theirs, ours) /= "")
   call new_run(theirs)
   theirs%grid%west = 1
   call check("a grid", difference(ours, theirs) == "grid")
   call new_run(theirs)
   theirs%window(4) = 5
   call check("a window", difference(ours, theirs) == "window")
   call finish()

contains

   subroutine new_run(run)
      type(identity_t), intent(out) :: run

      run%version = "1"
      run%keys = keys_of(case)
      run%read = '{"dem": "ab", "sets": "cd"}'
      run%decoded = "{}"
      run%total = 20_i8
      run%first = 1_i8
      run%last = 10_i8
   end subroutine new_run

   function differs(other) result(key)
      character(len=*), intent(in) :: other
      character(len=:), allocatable :: key

      key = differing_key(keys_of(case), keys_of(other), .false.)
   end function differs

   function held_key(other) result(key)
      character(len=*), intent(in) :: other
      character(len=:), allocatable :: key

      key = differing_key(keys_of(case), keys_of(other), .true.)
   end function held_key

   !> Case with one word replaced.
   function changed(old, new) result(text)
      character(len=*), intent(in) :: old, new
      character(len=:), allocatable :: text
      integer :: at

      at = index(case, old)
      text = case(:at - 1)//new//case(at + len(old):)
   end function changed
end program test_same_run
