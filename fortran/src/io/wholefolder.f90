! SPDX-License-Identifier: BSD-3-Clause
!> A folder of results that appears under its name only when it is whole. Its file run.csv begins
!> with `rockfall,` and lists the files, so that a later run may replace them, and nothing else.
module rockfall_wholefolder
   use rockfall_error, only: error_t, fail
   use rockfall_text_file, only: read_text
   use rockfall_filesystem, only: make_folder, remove_folder, remove_file, rename_path, &
                                  path_exists, is_folder, folder_of, name_of, temporary_name
   implicit none
   private
   public :: folder_t, check_folder, create_folder, new_file, complete_folder, discard_folder, &
             listed_files, list_name

   character(len=*), parameter :: list_name = "run.csv"

   type :: folder_t
      character(len=:), allocatable :: name
      character(len=:), allocatable, private :: part          !! where it is made
      character(len=200), allocatable :: files(:)
   end type folder_t

contains

   !> Refuse a place where a folder of these files cannot be put, before there is anything to put there.
   subroutine check_folder(name, files, error)
      character(len=*), intent(in) :: name, files(:)
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: parent
      type(folder_t) :: folder
      logical :: has_parent, is_file

      parent = folder_of(name)
      has_parent = is_folder(parent//".")
      is_file = path_exists(name)
      if (name_of(name) == "" .or. name_of(name) == "." .or. name_of(name) == "..") then
         call fail(error, name//": is no name for a new folder")
      else if (.not. has_parent) then
         call fail(error, name//": there is no folder "//parent)
      else if (is_folder(name)) then
         if (.not. is_ours(name)) &
            call fail(error, name//": is a folder that is no result of this program; " &
                      //"choose another name: output=NAME")
         if (.not. allocated(error)) call refuse_foreign(name, files, error)
      else if (is_file) then
         call fail(error, name//": is a file, not a folder")
      end if
      if (allocated(error)) return
      call create_folder(name, folder, error)
      if (.not. allocated(error)) call discard_folder(folder)
   end subroutine check_folder

   !> Begin a folder; end it with `complete_folder` or `discard_folder`.
   subroutine create_folder(name, folder, error)
      character(len=*), intent(in) :: name
      type(folder_t), intent(out) :: folder
      type(error_t), allocatable, intent(out) :: error

      folder%name = name
      folder%part = temporary_name(name)
      allocate (folder%files(0))
      if (.not. make_folder(folder%part)) &
         call fail(error, name//": cannot be written (is its folder writable?)")
   end subroutine create_folder

   !> The path of a file to be written into the folder.
   subroutine new_file(folder, name, path)
      type(folder_t), intent(inout) :: folder
      character(len=*), intent(in) :: name
      character(len=:), allocatable, intent(out) :: path

      folder%files = [character(len=len(folder%files)) :: folder%files, name]
      path = folder%part//"/"//name
   end subroutine new_file

   !> Give the folder its name. One of an earlier run gets the new files instead of its own, the
   !> list last.
   subroutine complete_folder(folder, error)
      type(folder_t), intent(inout) :: folder
      type(error_t), allocatable, intent(out) :: error
      character(len=200), allocatable :: old(:)
      logical :: ok
      integer :: k

      call refuse_foreign(folder%name, folder%files, error)
      if (allocated(error)) then
         call discard_folder(folder)
         return
      end if
      if (is_folder(folder%name)) then
         call listed_files(folder%name, old)
         ok = .true.
         do k = 1, size(old)
            if (.not. any(folder%files == old(k))) &
               ok = remove_file(folder%name//"/"//trim(old(k))) .and. ok
         end do
         do k = 1, size(folder%files)
            if (ok) ok = rename_path(folder%part//"/"//trim(folder%files(k)), &
                                     folder%name//"/"//trim(folder%files(k)))
         end do
         if (ok) ok = remove_folder(folder%part)
      else
         ok = rename_path(folder%part, folder%name)
      end if
      if (ok) return
      call discard_folder(folder)
      call fail(error, &
                folder%name//": cannot be written: its name, or a file in it, cannot be replaced")
   end subroutine complete_folder

   !> Leave nothing behind.
   subroutine discard_folder(folder)
      type(folder_t), intent(inout) :: folder
      logical :: ok
      integer :: k

      do k = 1, size(folder%files)
         ok = remove_file(folder%part//"/"//trim(folder%files(k)))
      end do
      ok = remove_folder(folder%part)
   end subroutine discard_folder

   !> Refuse to put files in the place of others that no earlier run has listed.
   subroutine refuse_foreign(name, files, error)
      character(len=*), intent(in) :: name, files(:)
      type(error_t), allocatable, intent(out) :: error
      character(len=200), allocatable :: old(:)
      integer :: k

      call listed_files(name, old)
      do k = 1, size(files)
         if (files(k) == list_name .or. any(old == files(k))) cycle
         if (.not. path_exists(name//"/"//trim(files(k)))) cycle
         call fail(error, name//"/"//trim(files(k))//": is there, and not of an earlier result; it is not overwritten")
         return
      end do
   end subroutine refuse_foreign

   !> Whether a folder is a result of this program.
   logical function is_ours(name)
      character(len=*), intent(in) :: name
      character(len=:), allocatable :: text
      type(error_t), allocatable :: error

      call read_text(name//"/"//list_name, text, error)
      is_ours = .false.
      if (.not. allocated(error)) is_ours = index(text, "rockfall,") == 1
   end function is_ours

   !> The files that an earlier run listed as its own and that are still there.
   subroutine listed_files(name, files)
      character(len=*), intent(in) :: name
      character(len=200), allocatable, intent(out) :: files(:)
      character(len=:), allocatable :: text, file
      type(error_t), allocatable :: error
      integer :: first, length
      logical :: exists

      allocate (files(0))
      call read_text(name//"/"//list_name, text, error)
      if (allocated(error)) return
      first = 1
      do while (first <= len(text))
         length = index(text(first:), achar(10)) - 1
         if (length < 0) length = len(text) - first + 1
         if (index(text(first:first + length - 1), "file,") == 1) then
            file = text(first + 5:first + length - 1)
            exists = path_exists(name//"/"//file)
            if (exists .and. index(file, "/") == 0 .and. len(file) <= 200) &
               files = [character(len=200) :: files, file]
         end if
         first = first + length + 1
      end do
   end subroutine listed_files
end module rockfall_wholefolder
