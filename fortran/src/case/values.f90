! SPDX-License-Identifier: BSD-3-Clause
!> Typed values of the keys of a namelist group, with error messages.
module rockfall_values
   use rockfall_kinds, only: wp, i8
   use rockfall_error, only: error_t, fail, gather
   use rockfall_decimal, only: parse_real, parse_integer, decimal_ok, decimal_malformed
   use rockfall_namelist, only: namelist_t, group_t, entry_t, raw_value
   use rockfall_decimal_commas, only: comma_number, misread_number, point_rule
   use rockfall_text, only: lower, integer_text, excerpt, joined, nearest_names
   implicit none
   private
   public :: has_key, value_count, text_of, get_text, get_integer, get_real, get_logical, refuse, refuse_list, &
             key_location, has_comma, check_names, unquoted, read_logical

   integer, parameter :: max_texts = 1000   !! maximum length of a list of texts

   !> Get the value or values of a key. An absent key leaves `value` unchanged: set the default before the call.
   !> Messages give file, group, key and value: `case.nml: &boulder density = 'a': must be ...`
   interface get_text
      module procedure get_text_one, get_text_list
   end interface get_text
   interface get_real
      module procedure get_real_one, get_real_list
   end interface get_real

contains

   !> Check that all groups and keys are in a table, and that only repeatable groups are repeated; the error lists all
   !> faults.
   pure subroutine check_names(list, groups, keys, repeatable, rule, error)
      type(namelist_t), intent(in) :: list
      character(len=*), intent(in) :: groups(:), keys(:)  !! one row per key; rows of a group are consecutive
      character(len=*), intent(in) :: repeatable(:), rule !! repeatable groups, and the message for other groups
      type(error_t), allocatable, intent(out) :: error
      type(error_t), allocatable :: fault
      integer :: g, e

      do g = 1, size(list%group)
         associate (group => list%group(g))
            if (.not. any(groups == group%name)) then
               call fail(fault, location(group%line)//": unknown group (similar groups: &" &
                         //joined(nearest(group%name, pack(groups, is_first(groups))), ", &")//")")
            else if (group%repeated .and. .not. (any(repeatable == group%name) .or. &
                                                 any(list%group(:g - 1)%name == group%name))) then
               call fail(fault, location(group%line)//": "//rule)
            end if
            if (allocated(fault)) then
               call gather(fault, error)
               cycle
            end if
            do e = 1, size(group%entry)
               if (any(groups == group%name .and. keys == group%entry(e)%key)) cycle
               call fail(fault, location(group%entry(e)%line)//" "//trim(group%entry(e)%key) &
                         //": unknown key (similar keys: " &
                         //joined(nearest(group%entry(e)%key, pack(keys, groups == group%name)), ", ")//")")
               call gather(fault, error)
            end do
         end associate
      end do

   contains

      pure function location(line) result(text)
         integer, intent(in) :: line
         character(len=:), allocatable :: text

         text = list%group(g)%file//": line "//integer_text(line)//": &"//trim(list%group(g)%name)
      end function location
   end subroutine check_names

   !> Return the few names most similar to a word.
   pure function nearest(word, names)
      character(len=*), intent(in) :: word, names(:)
      character(len=len(names)) :: nearest(min(3, size(names)))

      nearest = nearest_names(word, names, size(nearest))
   end function nearest

   !> Mask of the first name in each run of equal names.
   pure function is_first(names)
      character(len=*), intent(in) :: names(:)
      logical :: is_first(size(names))
      integer :: k

      is_first = [.true., (names(k) /= names(k - 1), k=2, size(names))]
   end function is_first

   pure logical function has_key(group, key)
      type(group_t), intent(in) :: group
      character(len=*), intent(in) :: key  !! lower case

      has_key = key_index(group, key) > 0
   end function has_key

   !> Number of values of `key`; 0 if absent.
   pure integer function value_count(group, key)
      type(group_t), intent(in) :: group
      character(len=*), intent(in) :: key
      integer :: k

      value_count = 0
      k = key_index(group, key)
      if (k > 0) value_count = size(group%entry(k)%value)
   end function value_count

   pure integer function key_index(group, key)
      type(group_t), intent(in) :: group
      character(len=*), intent(in) :: key

      do key_index = size(group%entry), 1, -1
         if (group%entry(key_index)%key == key) return
      end do
   end function key_index

   !> Set an error that shows `key` with its value (value `item`, if there are several) and the `rule`.
   pure subroutine refuse(group, key, rule, error, item)
      type(group_t), intent(in) :: group
      character(len=*), intent(in) :: key
      character(len=*), intent(in) :: rule  !! such as "must be > 0 [kg/m3]"
      type(error_t), allocatable, intent(out) :: error
      integer, intent(in), optional :: item
      character(len=:), allocatable :: message
      integer :: k, number

      k = key_index(group, key)
      message = key_location(group, key)
      if (k > 0) then
         number = 0
         if (present(item)) number = item
         if (number > 0 .and. size(group%entry(k)%value) > 1) then
            message = message//" (value "//integer_text(number)//")"
         end if
         message = message//" = "//shown_values(group%entry(k), number)
      end if
      call fail(error, message//": "//rule)
   end subroutine refuse

   !> Text of a key whose kind has been checked.
   pure function text_of(group, key) result(value)
      type(group_t), intent(in) :: group
      character(len=*), intent(in) :: key
      character(len=:), allocatable :: value  !! "" if absent
      type(error_t), allocatable :: error

      value = ""
      call get_text(group, key, value, error)
   end function text_of

   !> Like `refuse`, for numbers that are only invalid together; the message mentions commas that may be decimal.
   pure subroutine refuse_list(group, key, rule, error)
      type(group_t), intent(in) :: group
      character(len=*), intent(in) :: key, rule
      type(error_t), allocatable, intent(out) :: error
      integer :: k, item

      if (has_comma(group, key)) then
         k = key_index(group, key)
         item = comma_number(group%entry(k))
         call fail(error, key_location(group, key)//": "//point_rule(group%entry(k), item))
      else
         call refuse(group, key, rule, error)
      end if
   end subroutine refuse_list

   !> Return whether a key has a number that looks like an integer followed by a comma and its decimals.
   pure logical function has_comma(group, key)
      type(group_t), intent(in) :: group
      character(len=*), intent(in) :: key
      integer :: k

      has_comma = .false.
      k = key_index(group, key)
      if (k > 0) has_comma = comma_number(group%entry(k)) > 0
   end function has_comma

   !> Format `case.nml: &group key`, with the line of the group if it is repeated.
   pure function key_location(group, name) result(text)
      type(group_t), intent(in) :: group
      character(len=*), intent(in) :: name
      character(len=:), allocatable :: text

      text = group%file//": "
      if (group%repeated) text = text//"line "//integer_text(group%line)//": "
      text = text//"&"//trim(group%name)//" "//name
   end function key_location

   !> Values as written, shortened; all values if `item` is 0.
   pure function shown_values(entry, item)
      type(entry_t), intent(in) :: entry
      integer, intent(in) :: item
      character(len=:), allocatable :: shown_values
      integer :: i

      if (item > 0) then
         shown_values = excerpt(written_value(entry, item))
         return
      end if
      shown_values = written_value(entry, 1)
      do i = 2, size(entry%value)
         if (len(shown_values) > 100) exit
         shown_values = shown_values//", "//written_value(entry, i)
      end do
      shown_values = excerpt(shown_values)
   end function shown_values

   pure function written_value(entry, i)
      type(entry_t), intent(in) :: entry
      integer, intent(in) :: i
      character(len=:), allocatable :: written_value
      character(len=1) :: quote

      written_value = raw_value(entry, i)
      if (.not. entry%value(i)%quoted) return
      quote = entry%text(entry%value(i)%first - 1:entry%value(i)%first - 1)
      written_value = quote//written_value//quote
   end function written_value

   !> Find the index of `key` (0: absent), and check that it has a single value.
   pure subroutine find_single(group, key, k, error)
      type(group_t), intent(in) :: group
      character(len=*), intent(in) :: key
      integer, intent(out) :: k
      type(error_t), allocatable, intent(out) :: error

      k = key_index(group, key)
      if (value_count(group, key) > 1) &
         call refuse_list(group, key, "must be one value, not "//integer_text(value_count(group, key)), error)
   end subroutine find_single

   pure subroutine get_text_one(group, key, value, error)
      type(group_t), intent(in) :: group
      character(len=*), intent(in) :: key
      character(len=:), allocatable, intent(inout) :: value
      type(error_t), allocatable, intent(out) :: error
      integer :: k

      call find_single(group, key, k, error)
      if (k > 0 .and. .not. allocated(error)) call to_text(group, k, 1, value, error)
   end subroutine get_text_one

   !> Get texts of at most the caller's length, padded with blanks.
   pure subroutine get_text_list(group, key, values, error)
      type(group_t), intent(in) :: group
      character(len=*), intent(in) :: key
      character(len=*), allocatable, intent(inout) :: values(:)
      type(error_t), allocatable, intent(out) :: error
      character(len=len(values)), allocatable :: values_read(:)
      character(len=:), allocatable :: text
      integer :: i, k

      k = key_index(group, key)
      if (k == 0) return
      if (value_count(group, key) > max_texts) then
         call refuse(group, key, "must have at most "//integer_text(max_texts)//" texts", error)
         return
      end if
      allocate (values_read(value_count(group, key)))
      do i = 1, size(values_read)
         call to_text(group, k, i, text, error)
         if (allocated(error)) return
         values_read(i) = text
         if (len_trim(text) <= len(values_read)) cycle
         call refuse(group, key, "must be at most "//integer_text(len(values_read)) &
                     //" characters", error, i)
         return
      end do
      call move_alloc(values_read, values)
   end subroutine get_text_list

   pure subroutine get_integer(group, key, value, error)
      type(group_t), intent(in) :: group
      character(len=*), intent(in) :: key
      integer(i8), intent(inout) :: value
      type(error_t), allocatable, intent(out) :: error
      integer(i8) :: number
      integer :: k, status

      call find_single(group, key, k, error)
      if (k == 0 .or. allocated(error)) return
      status = decimal_malformed
      if (.not. group%entry(k)%value(1)%quoted) call parse_integer(raw_value(group%entry(k), 1), number, status)
      if (status == decimal_ok) then
         value = number
      else if (status == decimal_malformed) then
         call refuse(group, key, "must be an integer", error)
      else
         call refuse(group, key, "must be a 64-bit integer", error)
      end if
   end subroutine get_integer

   pure subroutine get_real_one(group, key, value, error)
      type(group_t), intent(in) :: group
      character(len=*), intent(in) :: key
      real(wp), intent(inout) :: value
      type(error_t), allocatable, intent(out) :: error
      integer :: k

      call find_single(group, key, k, error)
      if (k > 0 .and. .not. allocated(error)) call to_real(group, k, 1, value, error)
   end subroutine get_real_one

   pure subroutine get_real_list(group, key, values, error)
      type(group_t), intent(in) :: group
      character(len=*), intent(in) :: key
      real(wp), allocatable, intent(inout) :: values(:)
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: values_read(:)
      integer :: i, k

      k = key_index(group, key)
      if (k == 0) return
      allocate (values_read(size(group%entry(k)%value)))
      do i = 1, size(values_read)
         call to_real(group, k, i, values_read(i), error)
         if (allocated(error)) return
      end do
      i = misread_number(group%entry(k))
      if (i > 0) then
         call fail(error, key_location(group, key)//": "//point_rule(group%entry(k), i))
         return
      end if
      call move_alloc(values_read, values)
   end subroutine get_real_list

   pure subroutine get_logical(group, key, value, error)
      type(group_t), intent(in) :: group
      character(len=*), intent(in) :: key
      logical, intent(inout) :: value
      type(error_t), allocatable, intent(out) :: error
      logical :: switch, is_logical
      integer :: k

      call find_single(group, key, k, error)
      if (k == 0 .or. allocated(error)) return
      call read_logical(written_value(group%entry(k), 1), switch, is_logical)
      if (is_logical) value = switch
      if (.not. is_logical) call refuse(group, key, "must be .true. or .false.", error)
   end subroutine get_logical

   pure subroutine read_logical(word, value, is_logical)
      character(len=*), intent(in) :: word
      logical, intent(out) :: value, is_logical

      is_logical = .true.
      value = .false.
      select case (lower(word))
      case (".true.", ".t.", "true", "t"); value = .true.
      case (".false.", ".f.", "false", "f"); value = .false.
      case default; is_logical = .false.
      end select
   end subroutine read_logical

   pure subroutine to_text(group, k, i, value, error)
      type(group_t), intent(in) :: group
      integer, intent(in) :: k, i
      character(len=:), allocatable, intent(inout) :: value
      type(error_t), allocatable, intent(out) :: error

      if (group%entry(k)%value(i)%quoted) then
         value = unquoted(group%entry(k), i)
      else
         call refuse(group, trim(group%entry(k)%key), "must be text in quotes", error, i)
      end if
   end subroutine to_text

   !> Quoted value `i` of an entry; doubled quotes become single.
   pure function unquoted(entry, i) result(value)
      type(entry_t), intent(in) :: entry
      integer, intent(in) :: i
      character(len=:), allocatable :: value, written
      integer :: n, next

      written = written_value(entry, i)
      n = 0
      next = 2
      do while (next < len(written))
         n = n + 1
         written(n:n) = written(next:next)
         if (written(next:next) == written(len(written):)) next = next + 1
         next = next + 1
      end do
      value = written(:n)
   end function unquoted

   pure subroutine to_real(group, k, i, value, error)
      type(group_t), intent(in) :: group
      integer, intent(in) :: k, i
      real(wp), intent(inout) :: value
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: number
      integer :: status

      status = decimal_malformed
      if (.not. group%entry(k)%value(i)%quoted) then
         call parse_real(raw_value(group%entry(k), i), number, status)
      end if
      if (status == decimal_ok) then
         value = number
      else if (status /= decimal_malformed .or. is_not_finite(written_value(group%entry(k), i))) then
         call refuse(group, trim(group%entry(k)%key), "must be a finite real number", error, i)
      else
         call refuse(group, trim(group%entry(k)%key), "must be a real number", error, i)
      end if
   end subroutine to_real

   !> Return whether a word is Inf or NaN in Fortran's notation.
   pure logical function is_not_finite(word)
      character(len=*), intent(in) :: word
      integer :: first

      first = verify(word//"x", "+-")
      is_not_finite = index(lower(word(first:)), "inf") == 1 .or. &
                      index(lower(word(first:)), "nan") == 1
   end function is_not_finite
end module rockfall_values
