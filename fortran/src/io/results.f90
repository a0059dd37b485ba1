! SPDX-License-Identifier: BSD-3-Clause
!> A finished run as a folder of tables (CSV) and maps (ESRI ASCII), whole or not at all. Numbers
!> are written so that they read back the same.
module rockfall_results
   use, intrinsic :: ieee_arithmetic, only: ieee_is_nan
   use rockfall_kinds, only: wp, sp, i4, i8
   use rockfall_error, only: error_t, fail
   use rockfall_decimal, only: real_text
   use rockfall_text, only: lower, integer_text, joined
   use rockfall_wholefile, only: whole_file_t, create_file, put, complete_file, discard_file
   use rockfall_wholefolder, only: folder_t, create_folder, new_file, complete_folder, &
                                   discard_folder, list_name
   use rockfall_grid, only: grid_t
   use rockfall_variables, only: boulder_fields, boulder_counts, line_fields, vertex_fields, &
                                 histogram_fields, statuses
   use rockfall_maps, only: maps_t
   use rockfall_map_values, only: map_row
   use rockfall_histogram, only: n_bins
   use rockfall_result, only: boulder_row, boulder_count_row, line_row, vertex_row
   use rockfall_case, only: case_t, map_names, n_maps
   use rockfall_paths, only: version
   use rockfall_load, only: inputs_t
   use rockfall_simulate, only: results_t, map_tallies, bin_edge, rebound_counts
   implicit none
   private
   public :: write_folder, result_files

   character(len=1), parameter :: line_end = achar(10)
   character(len=*), parameter :: nodata = "-9999"

   !> A file in the making; after an error it is discarded, and further text is dropped.
   type :: table_t
      type(whole_file_t) :: file
      type(error_t), allocatable :: error
   end type table_t

contains

   !> Write all that the case asks for into the folder `name`.
   subroutine write_folder(name, text, case, inputs, results, error)
      character(len=*), intent(in) :: name
      character(len=*), intent(in) :: text  !! of the case, as it was run
      type(case_t), intent(in) :: case
      type(inputs_t), intent(in) :: inputs
      type(results_t), intent(in) :: results
      type(error_t), allocatable, intent(out) :: error
      type(folder_t) :: folder
      character(len=60), allocatable :: line_names(:)
      integer :: k

      call create_folder(name, folder, error)
      if (allocated(error)) return
      call write_boulders(folder, inputs, results, error)
      line_names = file_names(case)
      do k = 1, size(case%lines)
         if (.not. allocated(error)) &
            call write_line(folder, trim(line_names(k)), k, inputs, results, error)
      end do
      do k = 1, n_maps
         if (case%map(k) .and. .not. allocated(error)) &
            call write_map(folder, trim(map_names(k)), case%least_passages, results, error)
      end do
      if (case%rebounds .and. .not. allocated(error)) call write_histograms(folder, results, error)
      if (size(results%path) > 0 .and. .not. allocated(error)) &
         call write_paths(folder, inputs, results, error)
      if (.not. allocated(error)) call write_case(folder, text, error)
      if (.not. allocated(error)) call write_run(folder, case, inputs, results, error)
      if (allocated(error)) then
         call discard_folder(folder)
         error%message = name//": cannot be written" &
            //error%message(index(error%message, ": ", back=.true.):)
      else
         call complete_folder(folder, error)
      end if
   end subroutine write_folder

   !> The names of the files that write_folder writes for a case.
   function result_files(case) result(files)
      type(case_t), intent(in) :: case
      character(len=200), allocatable :: files(:)
      character(len=60), allocatable :: line_names(:)
      integer :: k

      files = [character(len=200) :: "boulders.csv", "case.nml", list_name]
      line_names = file_names(case)
      do k = 1, size(case%lines)
         files = [character(len=200) :: files, "line_"//trim(line_names(k))//".csv"]
      end do
      do k = 1, n_maps
         if (case%map(k)) files = [character(len=200) :: files, trim(map_names(k))//".asc"]
      end do
      if (case%rebounds) files = [character(len=200) :: files, "histograms.csv"]
      if (case%trajectories > 0) files = [character(len=200) :: files, "trajectories.csv"]
   end function result_files

   ! ---- tables -------------------------------------------------------------------------------

   !> One row for each boulder.
   subroutine write_boulders(folder, inputs, results, error)
      type(folder_t), intent(inout) :: folder
      type(inputs_t), intent(in) :: inputs
      type(results_t), intent(in) :: results
      type(error_t), allocatable, intent(out) :: error
      type(table_t) :: table
      integer(i8) :: b
      integer :: counts(size(boulder_counts))

      call open_table(folder, "boulders.csv", &
                      "boulder,"//joined(boulder_fields, ",")//","//joined(boulder_counts(:2), ","), table)
      do b = 1, results%boulders
         if (allocated(table%error)) exit
         counts = boulder_count_row(results%fate(b))
         call add(table, integer_text(b)//","//numbers(boulder_row(inputs%scene%dem, results%fate(b))) &
                  //","//trim(statuses(counts(1)))//","//integer_text(counts(2)))
      end do
      call close_table(table, error)
   end subroutine write_boulders

   !> One row for each boulder that crossed line `k`.
   subroutine write_line(folder, name, k, inputs, results, error)
      type(folder_t), intent(inout) :: folder
      character(len=*), intent(in) :: name
      integer, intent(in) :: k
      type(inputs_t), intent(in) :: inputs
      type(results_t), intent(in) :: results
      type(error_t), allocatable, intent(out) :: error
      type(table_t) :: table
      integer(i8) :: b

      call open_table(folder, "line_"//name//".csv", "boulder,"//joined(line_fields, ","), table)
      do b = 1, results%boulders
         if (allocated(table%error)) exit
         if (.not. results%crossing(k, b)%crossed) cycle
         call add(table, integer_text(b)//"," &
                  //numbers(line_row(inputs%scene%dem, results%fate(b), results%crossing(k, b))))
      end do
      call close_table(table, error)
   end subroutine write_line

   subroutine write_histograms(folder, results, error)
      type(folder_t), intent(inout) :: folder
      type(results_t), intent(in) :: results
      type(error_t), allocatable, intent(out) :: error
      type(table_t) :: table
      integer :: q, k

      call open_table(folder, "histograms.csv", "quantity,from,to,rebounds", table)
      do q = 1, size(histogram_fields)
         do k = 1, n_bins(q)
            call add(table, trim(histogram_fields(q))//","//real_text(bin_edge(q, k - 1))//"," &
                     //real_text(bin_edge(q, k))//","//integer_text(results%histogram(k, q)))
         end do
      end do
      call close_table(table, error)
   end subroutine write_histograms

   subroutine write_paths(folder, inputs, results, error)
      type(folder_t), intent(inout) :: folder
      type(inputs_t), intent(in) :: inputs
      type(results_t), intent(in) :: results
      type(error_t), allocatable, intent(out) :: error
      type(table_t) :: table
      integer :: b, k

      call open_table(folder, "trajectories.csv", "boulder,"//joined(vertex_fields, ","), table)
      do b = 1, size(results%path)
         do k = 1, size(results%path(b)%vertex)
            call add(table, integer_text(b)//"," &
                     //numbers(vertex_row(inputs%scene%dem, results%path(b)%vertex(k))))
         end do
      end do
      call close_table(table, error)
   end subroutine write_paths

   !> The case as it was run.
   subroutine write_case(folder, text, error)
      type(folder_t), intent(inout) :: folder
      character(len=*), intent(in) :: text
      type(error_t), allocatable, intent(out) :: error
      type(table_t) :: table

      call open_table(folder, "case.nml", text, table)
      call close_table(table, error)
   end subroutine write_case

   !> What was run, what came of it in numbers, and the files of the folder.
   subroutine write_run(folder, case, inputs, results, error)
      type(folder_t), intent(inout) :: folder
      type(case_t), intent(in) :: case
      type(inputs_t), intent(in) :: inputs
      type(results_t), intent(in) :: results
      type(error_t), allocatable, intent(out) :: error
      type(table_t) :: table
      integer(i8) :: counts(size(boulder_counts))
      integer :: k

      counts = rebound_counts(results)
      call open_table(folder, list_name, "rockfall,"//version, table)
      call add(table, "title,"//quoted(case%title))
      call add(table, "case,"//quoted(case%file))
      call add(table, "seed,"//integer_text(case%seed))
      call add(table, "boulders,"//integer_text(results%boulders))
      do k = 3, size(counts)
         call add(table, trim(boulder_counts(k))//","//integer_text(counts(k)))
      end do
      call add(table, "impact_set,"//quoted(case%sets))
      do k = 1, size(inputs%files)
         call add(table, "sha256_"//trim(inputs%files(k)%key)//","//inputs%files(k)%checksum)
      end do
      call add(table, "threads,"//integer_text(results%threads))
      call add(table, "wall_seconds,"//real_text(results%wall))
      call add(table, "cpu_seconds,"//real_text(results%cpu))
      do k = 1, size(folder%files)
         call add(table, "file,"//trim(folder%files(k)))
      end do
      call close_table(table, error)
   end subroutine write_run

   ! ---- maps ---------------------------------------------------------------------------------

   !> Row by row: a map in double precision would not fit where the map itself just does.
   subroutine write_map(folder, name, least, results, error)
      type(folder_t), intent(inout) :: folder
      character(len=*), intent(in) :: name
      integer, intent(in) :: least  !! passages, as for map_row
      type(results_t), intent(in), target :: results
      type(error_t), allocatable, intent(out) :: error
      type(table_t) :: table
      type(maps_t) :: maps
      integer :: j

      maps = map_tallies(results, [1, 1])
      associate (grid => results%grid)
         call open_table(folder, name//".asc", "ncols "//integer_text(grid%nx), table)
         call add(table, "nrows "//integer_text(grid%ny))
         call add(table, "xllcorner "//real_text(grid%west))
         call add(table, "yllcorner "//real_text(south(grid)))
         call add(table, "cellsize "//real_text(grid%cell))
         call add(table, "NODATA_value "//nodata)
         do j = 1, grid%ny
            if (allocated(table%error)) exit
            call add_map_row(table, maps, name, j, grid%nx, results%boulders, least)
         end do
      end associate
      call close_table(table, error)
   end subroutine write_map

   subroutine add_map_row(table, maps, name, j, nx, boulders, least)
      type(table_t), intent(inout) :: table
      type(maps_t), intent(in) :: maps
      character(len=*), intent(in) :: name
      integer, intent(in) :: j, nx, least
      integer(i8), intent(in) :: boulders
      real(sp) :: row(nx)
      integer :: i

      select case (name)
      case ("passages")
         call add_counts(table, maps%passages(:, j))
      case ("deposits")
         call add_counts(table, maps%deposits(:, j))
      case ("sources")
         call add_counts(table, maps%sources(:, j))
      case default
         call map_row(maps, name, j, boulders, least, row)
         do i = 1, nx
            if (ieee_is_nan(row(i))) then
               call add_cell(table, nodata, i == nx)
            else
               call add_cell(table, real_text(real(row(i), wp)), i == nx)
            end if
         end do
      end select
   end subroutine add_map_row

   subroutine add_counts(table, counts)
      type(table_t), intent(inout) :: table
      integer(i4), intent(in) :: counts(:)
      integer :: i

      do i = 1, size(counts)
         if (counts(i) == 0) then  ! most cells of most maps
            call add_cell(table, "0", i == size(counts))
         else
            call add_cell(table, integer_text(counts(i)), i == size(counts))
         end if
      end do
   end subroutine add_counts

   !> The southern edge: that with south + ny*cell == north, as readers add, where there is one.
   pure real(wp) function south(grid)
      type(grid_t), intent(in) :: grid
      real(wp) :: height, off
      integer :: k

      height = grid%ny*grid%cell
      south = grid%north - height
      do k = 1, 8
         off = grid%north - (south + height)
         if (abs(off) <= 0) return
         south = nearest(south, off)
      end do
      south = grid%north - height
   end function south

   ! ---- text ---------------------------------------------------------------------------------

   subroutine open_table(folder, name, header, table)
      type(folder_t), intent(inout) :: folder
      character(len=*), intent(in) :: name, header
      type(table_t), intent(out) :: table
      character(len=:), allocatable :: path

      call new_file(folder, name, path)
      call create_file(path, table%file, table%error)
      if (.not. allocated(table%error)) call add(table, header)
   end subroutine open_table

   !> Add a line.
   subroutine add(table, text)
      type(table_t), intent(inout) :: table
      character(len=*), intent(in) :: text

      if (.not. allocated(table%error)) call put(table%file, text//line_end, table%error)
   end subroutine add

   !> Add a cell of a raster.
   subroutine add_cell(table, text, last)
      type(table_t), intent(inout) :: table
      character(len=*), intent(in) :: text
      logical, intent(in) :: last  !! of its row

      if (.not. allocated(table%error)) &
         call put(table%file, text//merge(line_end, " ", last), table%error)
   end subroutine add_cell

   subroutine close_table(table, error)
      type(table_t), intent(inout) :: table
      type(error_t), allocatable, intent(out) :: error

      if (.not. allocated(table%error)) call complete_file(table%file, table%error)
      call move_alloc(table%error, error)
   end subroutine close_table

   !> Numbers with commas between.
   pure function numbers(values) result(text)
      real(wp), intent(in) :: values(:)
      character(len=:), allocatable :: text
      integer :: k

      text = real_text(values(1))
      do k = 2, size(values)
         text = text//","//real_text(values(k))
      end do
   end function numbers

   !> A text as a cell of a table.
   pure function quoted(text) result(cell)
      character(len=*), intent(in) :: text
      character(len=:), allocatable :: cell
      integer :: i

      cell = text
      if (scan(text, ",""") == 0) return
      cell = """"
      do i = 1, len(text)
         cell = cell//text(i:i)
         if (text(i:i) == """") cell = cell//""""
      end do
      cell = cell//""""
   end function quoted

   !> The names of the lines in letters that files may have, made different where need be.
   pure function file_names(case) result(names)
      type(case_t), intent(in) :: case
      character(len=60) :: names(size(case%lines))
      character(len=:), allocatable :: plain, name
      integer :: k, n

      do k = 1, size(names)
         plain = plain_name(case%lines(k)%name)
         name = plain
         n = 1
         do while (any(lower(names(:k - 1)) == lower(name)))
            n = n + 1
            name = plain//"_"//integer_text(n)
         end do
         names(k) = name
      end do
   end function file_names

   !> Letters, digits and _.+- of a name; what else there is becomes one _.
   pure function plain_name(name) result(plain)
      character(len=*), intent(in) :: name
      character(len=:), allocatable :: plain
      character(len=*), parameter :: known = &
         "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789_.+-"
      logical :: gap
      integer :: i

      plain = ""
      gap = .false.
      do i = 1, len(name)
         if (scan(name(i:i), known) == 1 .or. ichar(name(i:i)) > 127) then  ! or another alphabet
            if (gap) plain = plain//"_"
            gap = .false.
            plain = plain//name(i:i)
         else
            gap = .true.
         end if
      end do
      if (verify(plain, "._") == 0) plain = "line"
      plain = plain(verify(plain, "._"):verify(plain, "._", back=.true.))
   end function plain_name
end module rockfall_results
