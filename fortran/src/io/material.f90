! SPDX-License-Identifier: BSD-3-Clause
!> Zones of surface material: which row of the table each cell has.
module rockfall_material
   use, intrinsic :: ieee_arithmetic, only: ieee_is_nan
   use rockfall_kinds, only: wp, i2, i4, i8
   use rockfall_error, only: error_t, fail
   use rockfall_text, only: integer_text
   use rockfall_cells, only: no_id
   implicit none
   private
   public :: index_zones, without_row, check_sizes

   integer(i8), parameter :: shift = 2_i8**16  !! a key is id*shift + row: sorted, it keeps its row

contains

   !> The row of the table (from 1) of each cell; 0 where its zone has none. Cells without a zone
   !> have that of `default_zone`, if there is one.
   pure subroutine index_zones(ids, table_ids, default_zone, index)
      integer(i4), intent(in) :: ids(:, :)                 !! `no_id`: none
      integer(i4), intent(in) :: table_ids(:)              !! of the rows
      integer, intent(in), optional :: default_zone        !! in the table
      integer(i2), intent(out) :: index(:, :)
      integer(i8) :: keys(size(table_ids))
      integer(i4) :: id
      integer(i2) :: row
      integer :: i, j

      keys = [(table_ids(i)*shift + i, i=1, size(table_ids))]
      call sort(keys)
      id = no_id
      row = row_of(keys, id, default_zone)
      do j = 1, size(ids, 2)
         do i = 1, size(ids, 1)
            if (ids(i, j) /= id) then  ! most cells have the zone of their neighbour
               id = ids(i, j)
               row = row_of(keys, id, default_zone)
            end if
            index(i, j) = row
         end do
      end do
   end subroutine index_zones

   !> The row of a zone by bisection; 0 = none.
   pure integer(i2) function row_of(keys, id, default_zone) result(row)
      integer(i8), intent(in) :: keys(:)
      integer(i4), intent(in) :: id
      integer, intent(in), optional :: default_zone
      integer(i8) :: wanted
      integer :: low, high, middle

      wanted = id
      if (id == no_id .and. present(default_zone)) wanted = default_zone
      low = 1
      high = size(keys)
      do while (low < high)
         middle = (low + high)/2
         if (keys(middle) > wanted*shift) then
            high = middle
         else
            low = middle + 1
         end if
      end do
      row = 0
      if (keys(low) > wanted*shift .and. keys(low) < (wanted + 1)*shift) &
         row = int(keys(low) - wanted*shift, i2)
   end function row_of

   !> What to say of cells of known terrain whose zone is not in the table, or that have none.
   pure subroutine without_row(ids, index, known, path, table, error)
      integer(i4), intent(in) :: ids(:, :)
      integer(i2), intent(in) :: index(:, :)   !! of these ids
      logical, intent(in) :: known(:, :)       !! where there is terrain
      character(len=*), intent(in) :: path, table
      type(error_t), allocatable, intent(out) :: error
      integer(i8), allocatable :: found(:)
      character(len=:), allocatable :: zones
      integer :: first, k, n

      found = pack(int(ids, i8), index == 0 .and. known)
      n = count(found == no_id)
      if (n > 0) then
         call fail(error, path//": "//integer_text(n)//" cells of the terrain have no zone; " &
                   //"give them one, or set &surface default_zone")
         return
      end if
      call sort(found)
      zones = ""
      n = 0
      first = 1
      do k = 1, size(found)
         if (k < size(found)) then
            if (found(k + 1) == found(k)) cycle
         end if
         n = n + 1
         if (n <= 10) zones = zones//", zone "//integer_text(int(found(k)))//" (" &
                              //integer_text(k - first + 1)//" cells)"
         first = k + 1
      end do
      if (n > 10) zones = zones//", "//integer_text(n - 10)//" more"
      call fail(error, path//": "//zones(3:)//trim(merge(" has ", " have", n == 1)) &
                //" no row in "//table)
   end subroutine without_row

   !> Every zone of known terrain has the sizes that the method needs.
   pure subroutine check_sizes(sizes, used, ids, columns, method, table, error)
      real(wp), intent(in) :: sizes(:, :)        !! (1 or 3, rows) [m]
      logical, intent(in) :: used(:)             !! rows
      integer(i4), intent(in) :: ids(:)          !! of the rows
      character(len=*), intent(in) :: columns, method, table
      type(error_t), allocatable, intent(out) :: error
      integer :: k

      do k = 1, size(ids)
         if (.not. used(k) .or. .not. any(ieee_is_nan(sizes(:, k)))) cycle
         call fail(error, table//": zone "//integer_text(ids(k))//": "//columns &
                   //" needed for method "//method)
         return
      end do
   end subroutine check_sizes

   !> Ascending order (heap sort).
   pure subroutine sort(a)
      integer(i8), intent(inout) :: a(:)
      integer(i8) :: first, last, moved

      do first = size(a, kind=i8)/2, 1, -1
         call sink(a, first, size(a, kind=i8))
      end do
      do last = size(a, kind=i8), 2, -1
         moved = a(last)
         a(last) = a(1)
         a(1) = moved
         call sink(a, 1_i8, last - 1)
      end do
   end subroutine sort

   !> Move a(first) down until nothing above it in a(:last) is smaller.
   pure subroutine sink(a, first, last)
      integer(i8), intent(inout) :: a(:)
      integer(i8), intent(in) :: first, last
      integer(i8) :: place, child, moved

      moved = a(first)
      place = first
      do while (2*place <= last)
         child = 2*place
         if (child < last) then
            if (a(child + 1) > a(child)) child = child + 1
         end if
         if (a(child) <= moved) exit
         a(place) = a(child)
         place = child
      end do
      a(place) = moved
   end subroutine sink
end module rockfall_material
