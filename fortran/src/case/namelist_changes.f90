! SPDX-License-Identifier: BSD-3-Clause
!> Changes to a parsed namelist.
module rockfall_namelist_changes
   use rockfall_error, only: error_t
   use rockfall_namelist, only: namelist_t, mark_repeated
   implicit none
   private
   public :: change_namelist

contains

   !> Return a namelist without the `removed` entries (`group` or `group%key`, separated by spaces) and with the groups
   !> of a second namelist. Keys of the second replace those of the group with the same name; new groups are appended.
   pure subroutine change_namelist(list, removed, new, file, changed, error)
      type(namelist_t), intent(in) :: list, new
      character(len=*), intent(in) :: removed
      character(len=*), intent(in) :: file  !! file name, for messages
      type(namelist_t), intent(out) :: changed
      type(error_t), allocatable, intent(out) :: error
      integer :: e, g, k, n
      logical, allocatable :: kept(:)

      kept = [(.not. is_removed(trim(list%group(g)%name)), g=1, size(list%group))]
      changed%group = list%group(pack([(g, g=1, size(kept))], kept))
      n = size(changed%group)
      do g = 1, n
         associate (group => changed%group(g))
            group%file = file
            group%repeated = .false.
            kept = [(group%entry(e)%given .and. .not. is_removed(trim(group%name)//"%"//trim(group%entry(e)%key)), &
                     e=1, size(group%entry))]
            if (.not. all(kept)) group%entry = group%entry(pack([(e, e=1, size(kept))], kept))
         end associate
      end do
      do g = 1, size(new%group)
         k = findloc(changed%group(:n)%name == new%group(g)%name, .true., dim=1)
         if (k == 0) then
            changed%group = [changed%group, new%group(g)]
            cycle
         end if
         associate (group => changed%group(k), own => new%group(g)%entry)
            kept = [(.not. any(own%key == group%entry(e)%key), e=1, size(group%entry))]
            group%entry = [group%entry(pack([(e, e=1, size(kept))], kept)), own]
         end associate
      end do
      call mark_repeated(changed%group, file, error)

   contains

      pure logical function is_removed(name)
         character(len=*), intent(in) :: name

         is_removed = index(" "//removed//" ", " "//name//" ") > 0
      end function is_removed
   end subroutine change_namelist
end module rockfall_namelist_changes
