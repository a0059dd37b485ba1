! SPDX-License-Identifier: BSD-3-Clause
!> A finished run as one CF netCDF file: variables, dimensions and attributes as Python writes them.
module rockfall_ncresult
   use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan
   use netcdf, only: nf90_enomem, nf90_create, nf90_open, nf90_nowrite, nf90_close, nf90_def_dim, nf90_def_var, &
                     nf90_put_var, nf90_put_att, nf90_inquire_attribute, nf90_enddef, nf90_set_fill, nf90_strerror, nf90_noerr, &
                     nf90_netcdf4, nf90_clobber, nf90_nofill, nf90_global, nf90_edimsize, &
                     nf90_byte, nf90_char, nf90_int, nf90_int64, nf90_float, nf90_double
   use rockfall_kinds, only: wp, sp, i4, i8
   use rockfall_error, only: error_t, fail
   use rockfall_decimal, only: real_text
   use rockfall_filesystem, only: is_folder, path_exists, folder_of, temporary_name, remove_file, rename_path
   use rockfall_classicheader, only: overstates
   use rockfall_netcdf, only: text_attribute
   use rockfall_variables, only: variable_t, variable_table, boulder_fields, boulder_counts, &
                                 line_fields, vertex_fields, histogram_fields, statuses
   use rockfall_maps, only: maps_t
   use rockfall_map_values, only: map_row, map_min_count, is_count
   use rockfall_histogram, only: n_bins
   use rockfall_result, only: boulder_row, boulder_count_row, line_row, vertex_row
   use rockfall_case, only: case_t, map_names, n_maps
   use rockfall_paths, only: version
   use rockfall_load, only: inputs_t
   use rockfall_simulate, only: results_t, is_part, map_tallies, reached_cells, bin_edge, rebound_counts
   implicit none
   private
   public :: check_netcdf, write_netcdf

   integer, parameter :: block = 65536  !! boulders or cells on their way to the file

   !> A file in the making. After the first failure nothing more is asked of it.
   type :: file_t
      integer :: id = -1
      integer :: status = nf90_noerr  !! of the first failure
   end type file_t

   !> Variables by their identifiers, and the size of what they hold.
   type :: names_t
      integer :: boulder = 0, boulder_real(size(boulder_fields)) = 0, status = 0, impacts = 0
      integer :: count(size(boulder_counts)) = 0
      integer :: line = 0, line_real(size(line_fields)) = 0, line_vertex(3) = 0
      integer :: x = 0, y = 0, crs = 0, map(n_maps) = 0
      integer, dimension(size(histogram_fields)) :: bin = 0, bounds = 0, histogram = 0
      integer :: vertex_boulder = 0, vertex_real(size(vertex_fields)) = 0
      integer(i8), allocatable :: cell(:)  !! reached, counted from 0; of a part of a run
      integer :: tally_cell = 0, tally_counts = 0, tally_sums = 0, tally_maxima = 0, &
                 tally_classes = 0, fed(3) = 0
   end type names_t

contains

   !> Refuse a place where the file cannot be put, before there is anything to put there.
   subroutine check_netcdf(name, error)
      character(len=*), intent(in) :: name
      type(error_t), allocatable, intent(out) :: error
      logical :: has_parent, taken, foreign
      integer :: unit, status

      has_parent = is_folder(folder_of(name)//".")
      taken = is_folder(name)
      foreign = path_exists(name)
      if (foreign .and. .not. taken) foreign = .not. is_result(name)
      if (.not. has_parent) then
         call fail(error, name//": there is no folder "//folder_of(name))
      else if (taken) then
         call fail(error, name//": is a folder; a file name is needed")
      else if (foreign) then
         call fail(error, name//": is there, and not a result of a run that rockfall wrote; it is not overwritten")
      else
         open (newunit=unit, file=temporary_name(name), status="replace", action="write", &
               iostat=status)
         if (status == 0) close (unit, status="delete", iostat=status)
         if (status /= 0) call fail(error, name//": cannot be written (is its folder writable?)")
      end if
   end subroutine check_netcdf

   !> Whether a file says that it is a result of rockfall.
   logical function is_result(name)
      character(len=*), intent(in) :: name
      integer :: file, status

      is_result = .not. overstates(name)  ! the library would die of such a file
      if (.not. is_result) return
      is_result = nf90_open(name, nf90_nowrite, file) == nf90_noerr
      if (.not. is_result) return
      is_result = index(text_attribute(file, nf90_global, "source"), "rockfall ") == 1 &
                  .and. nf90_inquire_attribute(file, nf90_global, "boulders_asked") == nf90_noerr
      status = nf90_close(file)
   end function is_result

   !> Write the file, whole or not at all.
   subroutine write_netcdf(name, text, case, inputs, results, error)
      character(len=*), intent(in) :: name
      character(len=*), intent(in) :: text  !! of the case, as it was run
      type(case_t), intent(in) :: case
      type(inputs_t), intent(in) :: inputs
      type(results_t), intent(in) :: results
      type(error_t), allocatable, intent(out) :: error
      type(file_t) :: file
      type(names_t) :: names
      character(len=:), allocatable :: part
      logical :: done
      integer :: status

      part = temporary_name(name)
      file%status = nf90_create(part, ior(nf90_netcdf4, nf90_clobber), file%id)
      if (file%status == nf90_noerr) then
         call keep(file, nf90_set_fill(file%id, nf90_nofill, status))
         call define(file, names, text, case, inputs, results)
         call put_boulders(file, names, inputs, results)
         call put_lines(file, names, case, inputs, results)
         call put_maps(file, names, case, inputs, results)
         call put_histograms(file, names, case, results)
         call put_paths(file, names, inputs, results)
         if (is_part(results)) call put_tally(file, names, results)
         status = nf90_close(file%id)
         call keep(file, status)
      end if
      done = file%status == nf90_noerr
      if (done) done = rename_path(part, name)
      if (done) return
      done = remove_file(part)
      if (file%status == nf90_noerr) then
         call fail(error, name//": cannot be written: its name cannot be taken")
      else
         call fail(error, name//": cannot be written: "//trim(nf90_strerror(file%status)) &
                   //" (the disk may be full)")
      end if
   end subroutine write_netcdf

   !> Keep the first failure.
   subroutine keep(file, status)
      type(file_t), intent(inout) :: file
      integer, intent(in) :: status

      if (file%status == nf90_noerr) file%status = status
   end subroutine keep

   ! ---- dimensions, variables, attributes ----------------------------------------------------

   subroutine define(file, names, text, case, inputs, results)
      type(file_t), intent(inout) :: file
      type(names_t), intent(out) :: names
      character(len=*), intent(in) :: text
      type(case_t), intent(in) :: case
      type(inputs_t), intent(in) :: inputs
      type(results_t), intent(in) :: results
      integer :: boulder

      call define_global(file, text, case, inputs, results)
      boulder = dimension(file, "boulder", results%boulders)
      call define_boulders(file, names, boulder)
      if (size(case%lines) > 0) call define_lines(file, names, case, boulder)
      call define_crs(file, names, inputs, results)
      if (any(case%map)) call define_maps(file, names, case, results)
      if (case%rebounds) call define_histograms(file, names)
      if (size(results%path) > 0) call define_paths(file, names, results)
      if (is_part(results)) call define_tally(file, names, results)
      call keep(file, nf90_enddef(file%id))
   end subroutine define

   subroutine define_global(file, text, case, inputs, results)
      type(file_t), intent(inout) :: file
      character(len=*), intent(in) :: text
      type(case_t), intent(in) :: case
      type(inputs_t), intent(in) :: inputs
      type(results_t), intent(in) :: results
      character(len=:), allocatable :: checksums
      integer :: k

      checksums = ""
      do k = 1, size(inputs%files)
         checksums = checksums//", """//trim(inputs%files(k)%key)//""": """ &
            //inputs%files(k)%checksum//""""
         if (inputs%files(k)%key == "sets") &
            call note(file, nf90_global, "impact_set_checksum", inputs%files(k)%checksum)
      end do
      call note(file, nf90_global, "Conventions", "CF-1.8")
      call note(file, nf90_global, "title", case%title)
      call note(file, nf90_global, "source", &
                "rockfall "//version//", stochastic impact model of Bourrier et al. (2009)")
      call note(file, nf90_global, "version", version)
      call note(file, nf90_global, "case", text)
      call note(file, nf90_global, "case_file", case%file)
      call note(file, nf90_global, "impact_set", case%sets)
      call note(file, nf90_global, "input_checksums", "{"//checksums(3:)//"}")
      call keep(file, nf90_put_att(file%id, nf90_global, "seed", case%seed))
      call keep(file, nf90_put_att(file%id, nf90_global, "boulder_first", results%before + 1))
      call keep(file, nf90_put_att(file%id, nf90_global, "boulder_last", &
                                   results%before + results%boulders))
      call keep(file, nf90_put_att(file%id, nf90_global, "boulders_asked", results%asked))
      call keep(file, nf90_put_att(file%id, nf90_global, "complete", &
                                   merge(0_i8, 1_i8, is_part(results))))
      call keep(file, nf90_put_att(file%id, nf90_global, "threads", int(results%threads, i8)))
      call keep(file, nf90_put_att(file%id, nf90_global, "wall_seconds", results%wall))
      call keep(file, nf90_put_att(file%id, nf90_global, "cpu_seconds", results%cpu))
   end subroutine define_global

   subroutine define_boulders(file, names, boulder)
      type(file_t), intent(inout) :: file
      type(names_t), intent(inout) :: names
      integer, intent(in) :: boulder
      character(len=:), allocatable :: meanings
      integer :: k

      names%boulder = variable(file, "boulder", nf90_int64, [boulder], "1", "number of the boulder")
      do k = 1, size(boulder_fields)
         names%boulder_real(k) = described(file, "boulder", boulder_fields(k), "", nf90_double, &
                                           [boulder])
      end do
      names%status = described(file, "boulder", "status", "", nf90_byte, [boulder])
      meanings = trim(statuses(1))
      do k = 2, size(statuses)
         meanings = meanings//" "//trim(statuses(k))
      end do
      call keep(file, nf90_put_att(file%id, names%status, "flag_values", &
                                   [(int(k, 1), k=1, size(statuses))]))
      call note(file, names%status, "flag_meanings", meanings)
      names%impacts = described(file, "boulder", "impacts", "", nf90_int, [boulder])
      do k = 3, size(boulder_counts)
         names%count(k) = described(file, "count", boulder_counts(k), "", nf90_int64, [integer ::])
      end do
   end subroutine define_boulders

   subroutine define_lines(file, names, case, boulder)
      type(file_t), intent(inout) :: file
      type(names_t), intent(inout) :: names
      type(case_t), intent(in) :: case
      integer, intent(in) :: boulder
      character(len=*), parameter :: vertex_parts(3) = [character(len=4) :: "line", "x", "y"]
      integer :: line, letter, vertex, k

      line = dimension(file, "line", size(case%lines, kind=i8))
      letter = dimension(file, "line_name_length", int(name_length(case), i8))
      vertex = dimension(file, "line_vertex", &
                         int(sum([(size(case%lines(k)%x), k=1, size(case%lines))]), i8))
      call keep(file, nf90_def_var(file%id, "line", nf90_char, [letter, line], names%line))
      call note(file, names%line, "long_name", "name of the evaluation line")
      call note(file, names%line, "_Encoding", "utf-8")
      do k = 1, size(line_fields)
         names%line_real(k) = described(file, "line", line_fields(k), "line_", nf90_double, &
                                        [boulder, line])
      end do
      do k = 1, 3
         names%line_vertex(k) = described(file, "line_vertex", vertex_parts(k), "line_vertex_", &
                                          merge(nf90_int, nf90_double, k == 1), [vertex])
      end do
   end subroutine define_lines

   pure integer function name_length(case)
      type(case_t), intent(in) :: case
      integer :: k

      name_length = maxval([(len(case%lines(k)%name), k=1, size(case%lines))])
   end function name_length

   !> The grid mapping, also of coordinates that are on no map.
   subroutine define_crs(file, names, inputs, results)
      type(file_t), intent(inout) :: file
      type(names_t), intent(inout) :: names
      type(inputs_t), intent(in) :: inputs
      type(results_t), intent(in) :: results
      character(len=:), allocatable :: cell

      names%crs = variable(file, "crs", nf90_int, [integer ::], "1", "coordinate reference system")
      call fill(file, names%crs, nf90_int)
      associate (grid => results%grid)
         cell = real_text(grid%cell)
         call note(file, names%crs, "GeoTransform", &
                   real_text(grid%west)//" "//cell//" 0.0 "//real_text(grid%north) &
                   //" 0.0 -"//cell)
      end associate
      if (inputs%crs == "") return
      call note(file, names%crs, "crs_wkt", inputs%crs)
      call note(file, names%crs, "spatial_ref", inputs%crs)
   end subroutine define_crs

   subroutine define_maps(file, names, case, results)
      type(file_t), intent(inout) :: file
      type(names_t), intent(inout) :: names
      type(case_t), intent(in) :: case
      type(results_t), intent(in) :: results
      integer :: x, y, k, kind, fewest

      x = dimension(file, "x", int(results%grid%nx, i8))
      y = dimension(file, "y", int(results%grid%ny, i8))
      names%x = axis(file, "x", x, "easting of cell centres")
      names%y = axis(file, "y", y, "northing of cell centres")
      do k = 1, n_maps
         if (.not. case%map(k)) cycle
         kind = merge(nf90_int, nf90_float, is_count(map_names(k)))
         names%map(k) = described(file, "map", map_names(k), "", kind, [x, y], &
                                  [results%grid%nx, map_rows(results)])
         call note(file, names%map(k), "grid_mapping", "crs")
         fewest = map_min_count(map_names(k), case%least_passages)
         if (fewest > 0) call keep(file, nf90_put_att(file%id, names%map(k), "least_passages", fewest))
      end do
   end subroutine define_maps

   !> Rows of a map that are packed together.
   pure integer function map_rows(results)
      type(results_t), intent(in) :: results

      map_rows = max(1, min(results%grid%ny, block/results%grid%nx))
   end function map_rows

   integer function axis(file, name, dim, long_name) result(id)
      type(file_t), intent(inout) :: file
      character(len=1), intent(in) :: name
      integer, intent(in) :: dim
      character(len=*), intent(in) :: long_name

      id = variable(file, name, nf90_double, [dim], "m", long_name)
      call note(file, id, "standard_name", "projection_"//name//"_coordinate")
      call note(file, id, "axis", merge("X", "Y", name == "x"))
   end function axis

   subroutine define_histograms(file, names)
      type(file_t), intent(inout) :: file
      type(names_t), intent(inout) :: names
      type(variable_t) :: about
      character(len=:), allocatable :: bin
      integer :: k, dim, bound

      bound = dimension(file, "bound", 2_i8)
      do k = 1, size(histogram_fields)
         about = row_of("histogram", histogram_fields(k))
         bin = trim(about%name)//"_bin"
         dim = dimension(file, bin, int(n_bins(k), i8))
         names%bin(k) = variable(file, bin, nf90_double, [dim], trim(about%units), &
                                 trim(about%long_name))
         call note(file, names%bin(k), "bounds", bin//"_bounds")
         names%bounds(k) = variable(file, bin//"_bounds", nf90_double, [bound, dim], trim(about%units), &
                                    "edges of the bins of "//trim(about%name))
         call fill(file, names%bounds(k), nf90_double)
         names%histogram(k) = variable(file, trim(about%name)//"_histogram", nf90_int64, [dim], &
                                       "1", "rebounds by "//trim(about%long_name))
         call fill(file, names%histogram(k), nf90_int64)
         call note(file, names%histogram(k), "comment", trim(about%comment))
      end do
   end subroutine define_histograms

   subroutine define_paths(file, names, results)
      type(file_t), intent(inout) :: file
      type(names_t), intent(inout) :: names
      type(results_t), intent(in) :: results
      integer(i8) :: n
      integer :: vertex, k

      n = 0
      do k = 1, size(results%path)
         n = n + size(results%path(k)%vertex)
      end do
      vertex = dimension(file, "trajectory_vertex", n)
      names%vertex_boulder = described(file, "vertex", "boulder", "trajectory_", nf90_int64, &
                                       [vertex])
      do k = 1, size(vertex_fields)
         names%vertex_real(k) = described(file, "vertex", vertex_fields(k), "trajectory_", &
                                          nf90_double, [vertex])
      end do
   end subroutine define_paths

   !> The tallies of a part of a run, which add up to those of all of it.
   subroutine define_tally(file, names, results)
      type(file_t), intent(inout) :: file
      type(names_t), intent(inout) :: names
      type(results_t), intent(in) :: results
      integer :: cell

      names%cell = reached_cells(results)
      cell = dimension(file, "tally", size(names%cell, kind=i8))
      names%tally_cell = tally_variable(file, "cell", nf90_int64, [cell], &
                                        "index of the cell, by rows from the north-west")
      if (size(results%counts) > 0) names%tally_counts = layers("counts", nf90_int, size(results%counts, 3))
      if (size(results%sums) > 0) names%tally_sums = layers("sums", nf90_int64, size(results%sums, 3))
      if (size(results%greatest) > 0) &
         names%tally_maxima = layers("maxima", nf90_float, size(results%greatest, 3))
      if (size(results%column) > 0) &
         names%tally_classes = tally_variable( &
                               file, "classes", nf90_int, &
                               [dimension(file, "tally_class", int(results%plan%rows, i8)), cell], &
                               "counts of classes")
      if (size(results%stamp) > 0) call define_fed(file, names, results)

   contains

      integer function layers(name, kind, n) result(id)
         character(len=*), intent(in) :: name
         integer, intent(in) :: kind, n

         id = tally_variable(file, name, kind, &
                             [cell, dimension(file, "tally_"//name//"_layer", int(n, i8))], &
                             name//" of the maps, by layer")
      end function layers
   end subroutine define_tally

   !> The cells that the sources feed which the part cuts: others may have counted these sources there too.
   subroutine define_fed(file, names, results)
      type(file_t), intent(inout) :: file
      type(names_t), intent(inout) :: names
      type(results_t), intent(in) :: results
      integer :: fed

      fed = dimension(file, "tally_fed", size(results%fed%cell, kind=i8))
      names%fed(1) = tally_variable(file, "fed_cell", nf90_int64, [fed], "cell that a source feeds which the part cuts")
      names%fed(2) = tally_variable(file, "fed_source", nf90_int, [fed], "number of that source")
      names%fed(3) = tally_variable(file, "fed_boulders", nf90_int, [fed], "its boulders in the part")
   end subroutine define_fed

   integer function tally_variable(file, name, kind, dims, long_name) result(id)
      type(file_t), intent(inout) :: file
      character(len=*), intent(in) :: name, long_name
      integer, intent(in) :: kind, dims(:)

      id = variable(file, "tally_"//name, kind, dims, "1", long_name)
      call fill(file, id, kind)
   end function tally_variable

   integer function dimension(file, name, length) result(id)
      type(file_t), intent(inout) :: file
      character(len=*), intent(in) :: name
      integer(i8), intent(in) :: length

      id = 0
      if (length > huge(1)) then
         call keep(file, nf90_edimsize)
      else
         call keep(file, nf90_def_dim(file%id, name, int(length), id))
      end if
   end function dimension

   !> A variable with units (edges of bins have those of the bins, by CF) and a long name.
   integer function variable(file, name, kind, dims, units, long_name, piece) result(id)
      type(file_t), intent(inout) :: file
      character(len=*), intent(in) :: name, units, long_name
      integer, intent(in) :: kind, dims(:)
      integer, intent(in), optional :: piece(:)  !! packed in pieces of this shape

      id = 0
      if (present(piece)) then
         call keep(file, nf90_def_var(file%id, name, kind, dims, id, chunksizes=piece, &
                                      deflate_level=1, shuffle=.true.))
      else if (size(dims) == 0) then
         call keep(file, nf90_def_var(file%id, name, kind, id))
      else
         call keep(file, nf90_def_var(file%id, name, kind, dims, id))
      end if
      if (units /= "") call note(file, id, "units", units)
      call note(file, id, "long_name", long_name)
   end function variable

   !> A variable as its row of the table describes it, with a fill value.
   integer function described(file, group, name, before, kind, dims, piece) result(id)
      type(file_t), intent(inout) :: file
      character(len=*), intent(in) :: group, name, before
      integer, intent(in) :: kind, dims(:)
      integer, intent(in), optional :: piece(:)
      type(variable_t) :: about

      about = row_of(group, name)
      id = variable(file, before//trim(name), kind, dims, trim(about%units), &
                    trim(about%long_name), piece)
      if (about%comment /= "") call note(file, id, "comment", trim(about%comment))
      call fill(file, id, kind)
   end function described

   pure type(variable_t) function row_of(group, name) result(row)
      character(len=*), intent(in) :: group, name
      integer :: k

      do k = 1, size(variable_table)
         row = variable_table(k)
         if (row%group == group .and. row%name == name) return
      end do
   end function row_of

   !> What stands for a missing value: NaN, or -1 among counts.
   subroutine fill(file, id, kind)
      type(file_t), intent(inout) :: file
      integer, intent(in) :: id, kind
      real(wp) :: nan

      nan = ieee_value(nan, ieee_quiet_nan)
      select case (kind)
      case (nf90_byte); call keep(file, nf90_put_att(file%id, id, "_FillValue", -1_1))
      case (nf90_int); call keep(file, nf90_put_att(file%id, id, "_FillValue", -1_i4))
      case (nf90_int64); call keep(file, nf90_put_att(file%id, id, "_FillValue", -1_i8))
      case (nf90_float); call keep(file, nf90_put_att(file%id, id, "_FillValue", real(nan, sp)))
      case (nf90_double); call keep(file, nf90_put_att(file%id, id, "_FillValue", nan))
      end select
   end subroutine fill

   !> A text attribute.
   subroutine note(file, id, name, text)
      type(file_t), intent(inout) :: file
      integer, intent(in) :: id
      character(len=*), intent(in) :: name, text

      call keep(file, nf90_put_att(file%id, id, name, text))
   end subroutine note

   ! ---- values -------------------------------------------------------------------------------

   !> Some boulders at a time: rows become columns.
   subroutine put_boulders(file, names, inputs, results)
      type(file_t), intent(inout) :: file
      type(names_t), intent(in) :: names
      type(inputs_t), intent(in) :: inputs
      type(results_t), intent(in) :: results
      real(wp), allocatable :: rows(:, :)
      integer, allocatable :: counts(:, :)
      integer(i8) :: total(size(boulder_counts))
      integer :: first, n, k, status

      allocate (rows(block, size(boulder_fields)), counts(block, size(boulder_counts)), stat=status)
      if (status /= 0) then
         call keep(file, nf90_enomem)
         return
      end if
      do first = 1, int(results%boulders), block
         n = int(min(int(block, i8), results%boulders - first + 1))
         do k = 1, n
            rows(k, :) = boulder_row(inputs%scene%dem, results%fate(first + k - 1))
            counts(k, :) = boulder_count_row(results%fate(first + k - 1))
         end do
         call keep(file, nf90_put_var(file%id, names%boulder, &
                                      [(results%before + first + k - 1, k=1, n)], &
                                      [first]))
         do k = 1, size(rows, 2)
            call keep(file, nf90_put_var(file%id, names%boulder_real(k), rows(:n, k), [first]))
         end do
         call keep(file, nf90_put_var(file%id, names%status, int(counts(:n, 1), 1), [first]))
         call keep(file, nf90_put_var(file%id, names%impacts, counts(:n, 2), [first]))
         if (file%status /= nf90_noerr) return
      end do
      total = rebound_counts(results)
      do k = 3, size(total)
         call keep(file, nf90_put_var(file%id, names%count(k), total(k)))
      end do
   end subroutine put_boulders

   subroutine put_lines(file, names, case, inputs, results)
      type(file_t), intent(inout) :: file
      type(names_t), intent(in) :: names
      type(case_t), intent(in) :: case
      type(inputs_t), intent(in) :: inputs
      type(results_t), intent(in) :: results
      real(wp), allocatable :: rows(:, :)
      integer :: first, line, n, k, vertex, status

      allocate (rows(block, size(line_fields)), stat=status)
      if (status /= 0) then
         call keep(file, nf90_enomem)
         return
      end if
      vertex = 1
      do line = 1, size(case%lines)
         call put_line_itself(file, names, case, line, vertex)
         do first = 1, int(results%boulders), block
            n = int(min(int(block, i8), results%boulders - first + 1))
            do k = 1, n
               rows(k, :) = line_row(inputs%scene%dem, results%fate(first + k - 1), &
                                     results%crossing(line, first + k - 1))
            end do
            do k = 1, size(rows, 2)
               call keep(file, nf90_put_var(file%id, names%line_real(k), rows(:n, k), &
                                            [first, line], [n, 1]))
            end do
            if (file%status /= nf90_noerr) return
         end do
      end do
   end subroutine put_lines

   !> Its name, filled up with zeros, and its vertices.
   subroutine put_line_itself(file, names, case, line, vertex)
      type(file_t), intent(inout) :: file
      type(names_t), intent(in) :: names
      type(case_t), intent(in) :: case
      integer, intent(in) :: line
      integer, intent(inout) :: vertex  !! the first of it
      character(len=:), allocatable :: name
      integer :: n

      associate (this => case%lines(line))
         name = this%name//repeat(achar(0), name_length(case) - len(this%name))
         n = size(this%x)
         call keep(file, nf90_put_var(file%id, names%line, name, [1, line], [len(name), 1]))
         call keep(file, nf90_put_var(file%id, names%line_vertex(1), spread(line - 1, 1, n), &
                                      [vertex]))
         call keep(file, nf90_put_var(file%id, names%line_vertex(2), this%x, [vertex]))
         call keep(file, nf90_put_var(file%id, names%line_vertex(3), this%y, [vertex]))
         vertex = vertex + n
      end associate
   end subroutine put_line_itself

   subroutine put_maps(file, names, case, inputs, results)
      type(file_t), intent(inout) :: file
      type(names_t), intent(in) :: names
      type(case_t), intent(in) :: case
      type(inputs_t), intent(in) :: inputs
      type(results_t), intent(in), target :: results
      type(maps_t) :: maps
      integer :: k, i

      call keep(file, nf90_put_var(file%id, names%crs, 0))
      if (.not. any(case%map)) return
      maps = map_tallies(results, [1, 1])
      associate (grid => inputs%grid)
         call keep(file, nf90_put_var(file%id, names%x, &
                                      [(grid%west + (results%at(1) + i - 1.5_wp)*grid%cell, i=1, results%grid%nx)]))
         call keep(file, nf90_put_var(file%id, names%y, &
                                      [(grid%north - (results%at(2) + i - 1.5_wp)*grid%cell, i=1, results%grid%ny)]))
      end associate
      do k = 1, n_maps
         if (.not. case%map(k)) cycle
         select case (map_names(k))
         case ("passages"); call keep(file, nf90_put_var(file%id, names%map(k), maps%passages))
         case ("sources"); call keep(file, nf90_put_var(file%id, names%map(k), maps%sources))
         case ("deposits"); call keep(file, nf90_put_var(file%id, names%map(k), maps%deposits))
         case default; call put_real_map(file, names%map(k), trim(map_names(k)), case, results)
         end select
      end do
   end subroutine put_maps

   !> Some rows at a time.
   subroutine put_real_map(file, id, name, case, results)
      type(file_t), intent(inout) :: file
      integer, intent(in) :: id
      character(len=*), intent(in) :: name
      type(case_t), intent(in) :: case
      type(results_t), intent(in), target :: results
      type(maps_t) :: maps
      real(sp), allocatable :: rows(:, :)
      integer :: first, n, j

      maps = map_tallies(results, [1, 1])
      associate (nx => results%grid%nx, ny => results%grid%ny)
         allocate (rows(nx, map_rows(results)))
         do first = 1, ny, size(rows, 2)
            n = min(size(rows, 2), ny - first + 1)
            do j = 1, n
               call map_row(maps, name, first + j - 1, results%boulders, case%least_passages, rows(:, j))
            end do
            call keep(file, nf90_put_var(file%id, id, rows(:, :n), [1, first], [nx, n]))
            if (file%status /= nf90_noerr) return
         end do
      end associate
   end subroutine put_real_map

   subroutine put_histograms(file, names, case, results)
      type(file_t), intent(inout) :: file
      type(names_t), intent(in) :: names
      type(case_t), intent(in) :: case
      type(results_t), intent(in) :: results
      real(wp), allocatable :: edge(:)
      integer :: k, i, n

      if (.not. case%rebounds) return
      do k = 1, size(histogram_fields)
         n = n_bins(k)
         edge = [(bin_edge(k, i), i=0, n)]
         call keep(file, nf90_put_var(file%id, names%bin(k), (edge(:n) + edge(2:))/2))
         call keep(file, nf90_put_var(file%id, names%bounds(k), &
                                      transpose(reshape([edge(:n), edge(2:)], [n, 2]))))
         call keep(file, nf90_put_var(file%id, names%histogram(k), results%histogram(:n, k)))
      end do
   end subroutine put_histograms

   subroutine put_paths(file, names, inputs, results)
      type(file_t), intent(inout) :: file
      type(names_t), intent(in) :: names
      type(inputs_t), intent(in) :: inputs
      type(results_t), intent(in) :: results
      real(wp), allocatable :: rows(:, :)
      integer :: b, k, n, first

      first = 1
      do b = 1, size(results%path)
         n = size(results%path(b)%vertex)
         allocate (rows(n, size(vertex_fields)))
         do k = 1, n
            rows(k, :) = vertex_row(inputs%scene%dem, results%path(b)%vertex(k))
         end do
         call keep(file, nf90_put_var(file%id, names%vertex_boulder, spread(results%before + b, 1, n), &
                                      [first]))
         do k = 1, size(rows, 2)
            call keep(file, nf90_put_var(file%id, names%vertex_real(k), rows(:, k), [first]))
         end do
         deallocate (rows)
         if (file%status /= nf90_noerr) return
         first = first + n
      end do
   end subroutine put_paths

   subroutine put_tally(file, names, results)
      type(file_t), intent(inout) :: file
      type(names_t), intent(in) :: names
      type(results_t), intent(in) :: results
      integer(i4), allocatable :: classes(:, :)
      integer, allocatable :: i(:), j(:)
      integer :: k, layer

      associate (nx => size(results%counts, 1), n => size(names%cell))
         allocate (i(n), j(n))
         i = int(mod(names%cell, int(nx, i8))) + 1
         j = int(names%cell/nx) + 1
         call keep(file, nf90_put_var(file%id, names%tally_cell, names%cell))
         if (size(results%stamp) > 0) then
            call keep(file, nf90_put_var(file%id, names%fed(1), results%fed%cell))
            call keep(file, nf90_put_var(file%id, names%fed(2), results%fed%source))
            call keep(file, nf90_put_var(file%id, names%fed(3), results%fed%boulders))
         end if
         do layer = 1, size(results%counts, 3)
            call keep(file, nf90_put_var(file%id, names%tally_counts, &
                                         [(results%counts(i(k), j(k), layer), k=1, n)], [1, layer], [n, 1]))
         end do
         do layer = 1, size(results%sums, 3)
            call keep(file, nf90_put_var(file%id, names%tally_sums, &
                                         [(results%sums(i(k), j(k), layer), k=1, n)], [1, layer], [n, 1]))
         end do
         do layer = 1, size(results%greatest, 3)
            call keep(file, nf90_put_var(file%id, names%tally_maxima, &
                                         [(results%greatest(i(k), j(k), layer), k=1, n)], [1, layer], [n, 1]))
         end do
         if (size(results%column) == 0) return
         allocate (classes(results%plan%rows, n), source=0_i4)
         do k = 1, n
            if (results%column(i(k), j(k)) > 0) classes(:, k) = results%bin_counts(:, results%column(i(k), j(k)))
         end do
         call keep(file, nf90_put_var(file%id, names%tally_classes, classes))
      end associate
   end subroutine put_tally
end module rockfall_ncresult
