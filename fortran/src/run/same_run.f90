! SPDX-License-Identifier: BSD-3-Clause
!> Comparison of runs: whether parts belong to the same run, and whether cases are equal in meaning.
module rockfall_same_run
   use rockfall_kinds, only: i8
   use rockfall_error, only: error_t
   use rockfall_grid, only: grid_t
   use rockfall_namelist, only: namelist_t, group_t
   use rockfall_case_keys, only: read_keys, key_t, key_table, plain
   implicit none
   private
   public :: identity_t, difference, differing_key, keys_of

   !> Identity of a run, and of a range of its boulders.
   type :: identity_t
      character(len=:), allocatable :: version        !! version of this software
      type(namelist_t) :: keys                        !! complete keys of the case
      character(len=:), allocatable :: read, decoded  !! checksums of inputs by name, as stored in files (JSON)
      integer(i8) :: total = 0, first = 0, last = 0   !! boulders in the run; first and last in the range
      type(grid_t) :: grid                            !! grid of the terrain
      integer :: window(4) = 0                        !! window of the maps: first column and row, columns, rows
   end type identity_t

contains

   !> Describe the first difference between two parts; "" if the other part has the first boulders of the same run.
   pure function difference(ours, theirs) result(what)
      type(identity_t), intent(in) :: ours, theirs
      character(len=:), allocatable :: what

      what = "version"
      if (ours%version /= theirs%version) return
      what = differing_key(ours%keys, theirs%keys, of_arrays=.false.)
      if (what /= "") return
      what = "boulders"
      if (ours%total /= theirs%total .or. ours%first /= theirs%first) return
      if (theirs%last < ours%first .or. theirs%last > ours%last) return
      what = differing_checksum(ours%read, theirs%read)
      if (what == "") what = differing_checksum(ours%decoded, theirs%decoded)
      if (what /= "") return
      what = "grid"
      if (any([ours%grid%nx, ours%grid%ny] /= [theirs%grid%nx, theirs%grid%ny])) return
      associate (a => [ours%grid%west, ours%grid%north, ours%grid%cell], &
                 b => [theirs%grid%west, theirs%grid%north, theirs%grid%cell])
         if (any(a < b .or. a > b)) return
      end associate
      what = "window"
      if (any(ours%window /= theirs%window)) return
      what = ""
   end function difference

   !> Name of the first input whose checksums differ; "" if none.
   pure function differing_checksum(ours, theirs) result(name)
      character(len=*), intent(in) :: ours, theirs
      character(len=:), allocatable :: name
      integer :: at, begin

      name = ""
      if (ours == theirs) return
      do at = 1, min(len(ours), len(theirs))
         if (ours(at:at) /= theirs(at:at)) exit
      end do
      name = ours
      if (ours(at:min(at, len(ours))) == "}") name = theirs
      if (ours(at:min(at, len(ours))) == "}" .or. theirs(at:min(at, len(theirs))) == "}") at = at + 4  ! next name
      begin = max(index(name(:min(at, len(name))), '{"', back=.true.) + 2, &
                  index(name(:min(at, len(name))), ', "', back=.true.) + 3)
      name = name(begin:)
      if (index(name, '"') > 0) name = name(:index(name, '"') - 1)
      if (name == "") name = "input"
   end function differing_checksum

   !> Keys in the text of a case; none if the text is not a case.
   pure type(namelist_t) function keys_of(text) result(keys)
      character(len=*), intent(in) :: text
      type(error_t), allocatable :: error

      call read_keys(text, "", keys, error)
      if (allocated(error)) keys = namelist_t()
   end function keys_of

   !> First key, as `&group key`, whose values differ between two cases; "" if none. Compares the keys for the arrays of
   !> a scene file, or all keys that must agree to continue a run. Returns "&case" if either text is not a case.
   pure function differing_key(ours, theirs, of_arrays) result(name)
      type(namelist_t), intent(in) :: ours, theirs
      logical, intent(in) :: of_arrays
      character(len=:), allocatable :: name
      integer :: k

      name = "&case"
      if (.not. (allocated(ours%group) .and. allocated(theirs%group))) return
      do k = 1, size(key_table)
         associate (key => key_table(k))
            if (of_arrays .and. .not. key%of_scene) cycle
            if (key%group == "case" .and. key%name == "threads") cycle  ! does not affect results
            name = "&"//trim(key%group)//" "//trim(key%name)
            if (.not. same_values(groups_of(ours, key%group), groups_of(theirs, key%group), key)) return
         end associate
      end do
      name = ""
   end function differing_key

   pure function groups_of(list, name) result(groups)
      type(namelist_t), intent(in) :: list
      character(len=*), intent(in) :: name
      type(group_t), allocatable :: groups(:)

      groups = pack(list%group, list%group%name == name)
   end function groups_of

   !> Return whether groups with the same name have equal values of a key, whatever their notation.
   pure logical function same_values(ours, theirs, key) result(same)
      type(group_t), intent(in) :: ours(:), theirs(:)
      type(key_t), intent(in) :: key
      integer :: g

      same = size(ours) == size(theirs)
      do g = 1, size(ours)
         if (same) same = plain(ours(g), key) == plain(theirs(g), key)
      end do
   end function same_values
end module rockfall_same_run
