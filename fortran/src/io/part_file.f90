! SPDX-License-Identifier: BSD-3-Clause
!> The part file (docs/files.md): results of some boulders of a run, with tallies that add up to those of all. A
!> checkpoint, a shard's result and this program's result are one; `rockfall` reads and writes the same.
module rockfall_part_file
   use, intrinsic :: ieee_arithmetic, only: ieee_is_nan, ieee_is_finite
   use netcdf, only: nf90_global, nf90_copy_att, nf90_get_var, nf90_put_var, nf90_inq_attname, &
                     nf90_inquire_variable, nf90_put_att, nf90_strerror, nf90_byte, nf90_int, nf90_int64, &
                     nf90_float, nf90_double
   use rockfall_kinds, only: wp, sp, i1, i4, i8
   use rockfall_error, only: error_t, fail
   use rockfall_text, only: joined
   use rockfall_version, only: version
   use rockfall_filesystem, only: replace_file, remove_file
   use rockfall_netcdf_file, only: netcdf_file_t, open_netcdf, create_netcdf, close_netcdf, keep, sound, mark_damaged, &
                                   fail_damaged, length_of, expected, text_of, integer_of, integers_of, real_of, dimension, variable, note
   use rockfall_variables, only: variable_t, variable_table, boulder_fields, boulder_counts, line_fields, vertex_fields, &
                                 histogram_fields, statuses
   use rockfall_histogram, only: n_bins
   use rockfall_maps, only: maps_t
   use rockfall_source_maps, only: contributing_t, contributing_cells, partial_sources, boulders_within, settle
   use rockfall_case, only: case_t
   use rockfall_case_file, only: differing_key
   use rockfall_scene_file, only: inputs_t
   use rockfall_run_loop, only: results_t, map_tallies
   implicit none
   private
   public :: write_part, read_part, boulders_in

   integer(i8), parameter :: layout = 1          !! of the file, as in part_file.py
   integer, parameter :: block = 65536           !! cells on their way to the file
   character(len=*), parameter :: sums_of(2) = [character(len=17) :: "input_checksums", "decoded_checksums"]

   !> The tallies of cells, gathered: where they were reached, and what partial sources contribute.
   type :: tally_t
      integer(i8), allocatable :: cell(:)  !! counted from 0
      type(contributing_t) :: fed
   end type tally_t

contains

   ! ---- to disk ------------------------------------------------------------------------------

   !> Put the boulders done into a file, whole and on disk before it takes its name, by way of `part`.
   subroutine write_part(name, part, case, text, inputs, results, error)
      character(len=*), intent(in) :: name, part
      type(case_t), intent(in) :: case
      character(len=*), intent(in) :: text  !! of the case, as it is run
      type(inputs_t), intent(in) :: inputs
      type(results_t), intent(inout), target :: results
      type(error_t), allocatable, intent(out) :: error
      type(netcdf_file_t) :: file
      type(tally_t) :: tally
      type(maps_t) :: maps
      logical :: done
      integer :: boulder

      maps = map_tallies(results, [1, 1])
      tally%fed = contributing_cells(maps, inputs%scene%release, results%before + 1, results%before + results%done)
      tally%cell = reached_cells(results)
      call create_netcdf(part, file)
      if (sound(file)) then
         call define_global(file, case, text, inputs, results)
         call define_place(file, inputs, results)
         call write_boulders(file, results, boulder)
         if (size(case%lines) > 0) call write_lines(file, results, boulder)
         call settle(maps, inputs%scene%release, tally%fed, 1)
         call write_tallies(file, results, tally)
         call settle(maps, inputs%scene%release, tally%fed, -1)
         if (case%rebounds) call write_histograms(file, results)
         if (allocated(results%vertex)) call write_trajectories(file, results)
      end if
      call close_netcdf(file)
      done = sound(file)
      if (done) done = replace_file(part, name)
      if (done) return
      done = remove_file(part)
      if (sound(file)) then
         call fail(error, name//": cannot be written: its name cannot be taken")
      else
         call fail(error, name//": cannot be written: "//trim(nf90_strerror(file%status))//" (the disk may be full)")
      end if
   end subroutine write_part

   subroutine define_global(file, case, text, inputs, results)
      type(netcdf_file_t), intent(inout) :: file
      type(case_t), intent(in) :: case
      character(len=*), intent(in) :: text
      type(inputs_t), intent(in) :: inputs
      type(results_t), intent(in) :: results

      call note(file, nf90_global, "Conventions", "CF-1.8")
      call keep(file, nf90_put_att(file%id, nf90_global, "part_layout", layout))
      call note(file, nf90_global, "title", case%title)
      call note(file, nf90_global, "source", "rockfall "//version//", stochastic impact model of Bourrier et al. (2009)")
      call note(file, nf90_global, "version", version)
      call note(file, nf90_global, "case", text)
      call note(file, nf90_global, "case_file", inputs%case_file)
      call note(file, nf90_global, "impact_set", case%sets)
      call note(file, nf90_global, "impact_set_checksum", inputs%impact_set_checksum)
      call note(file, nf90_global, "input_checksums", inputs%input_checksums)
      call note(file, nf90_global, "decoded_checksums", inputs%decoded_checksums)
      call keep(file, nf90_put_att(file%id, nf90_global, "seed", case%seed))
      call keep(file, nf90_put_att(file%id, nf90_global, "boulder_first", results%before + 1))
      call keep(file, nf90_put_att(file%id, nf90_global, "boulder_last", results%before + results%done))
      call keep(file, nf90_put_att(file%id, nf90_global, "boulders_asked", results%asked))
      call keep(file, nf90_put_att(file%id, nf90_global, "complete", merge(1_i8, 0_i8, results%done == results%asked)))
      call keep(file, nf90_put_att(file%id, nf90_global, "threads", int(results%threads, i8)))
      call keep(file, nf90_put_att(file%id, nf90_global, "wall_seconds", results%wall))
      call keep(file, nf90_put_att(file%id, nf90_global, "cpu_seconds", results%cpu))
   end subroutine define_global

   !> The grid mapping of the terrain, as the scene file has it, and the cells of it that maps cover.
   subroutine define_place(file, inputs, results)
      type(netcdf_file_t), intent(inout) :: file
      type(inputs_t), intent(in) :: inputs
      type(results_t), intent(in) :: results
      character(len=128) :: name
      integer :: crs, k, n

      crs = variable(file, "crs", nf90_int, [integer ::], "1", "coordinate reference system", "")
      n = 0
      call keep(file, nf90_inquire_variable(inputs%file%id, inputs%crs, natts=n))
      do k = 1, n
         call keep(file, nf90_inq_attname(inputs%file%id, inputs%crs, k, name))
         call keep(file, nf90_copy_att(inputs%file%id, inputs%crs, trim(name), file%id, crs))
      end do
      call keep(file, nf90_put_var(file%id, crs, 0))
      call keep(file, nf90_put_att(file%id, nf90_global, "terrain_cells", [inputs%arrays%grid%nx, inputs%arrays%grid%ny]))
      call keep(file, nf90_put_att(file%id, nf90_global, "map_window", window_of(results)))
   end subroutine define_place

   !> First column and row, from 0, and number of columns and rows of the maps.
   pure function window_of(results) result(window)
      type(results_t), intent(in) :: results
      integer :: window(4)

      window = [results%at - 1, results%grid%nx, results%grid%ny]
   end function window_of

   !> A variable as its row of the table describes it.
   integer function described(file, group, name, dims) result(id)
      type(netcdf_file_t), intent(inout) :: file
      character(len=*), intent(in) :: group, name
      integer, intent(in) :: dims(:)
      type(variable_t) :: row
      character(len=:), allocatable :: units, long_name
      integer :: kind

      row = variable_table(findloc(variable_table%group == group .and. variable_table%name == name, .true., dim=1))
      kind = merge(nf90_int64, nf90_double, row%kind == "integer")
      if (group == "boulder" .and. row%kind == "integer") kind = merge(nf90_byte, nf90_int, name == "status")
      units = trim(row%units)
      long_name = trim(row%long_name)
      if (group == "histogram") then
         units = "1"
         long_name = "rebounds by "//long_name
      end if
      id = variable(file, name_of(group, name), kind, dims, units, long_name, trim(row%comment))
   end function described

   !> The name of a variable in files.
   pure function name_of(group, name) result(full)
      character(len=*), intent(in) :: group, name
      character(len=:), allocatable :: full

      full = trim(name)
      select case (group)
      case ("line"); full = "line_"//full
      case ("vertex"); full = "trajectory_"//full
      case ("histogram"); full = full//"_histogram"
      end select
   end function name_of

   subroutine write_boulders(file, results, boulder)
      type(netcdf_file_t), intent(inout) :: file
      type(results_t), intent(in) :: results
      integer, intent(out) :: boulder  !! their dimension
      integer :: id, k, n

      n = int(results%done)
      boulder = dimension(file, "boulder", results%done)
      do k = 1, size(boulder_fields)
         id = described(file, "boulder", trim(boulder_fields(k)), [boulder])
         call keep(file, nf90_put_var(file%id, id, results%boulder(:n, k)))
      end do
      id = described(file, "boulder", "status", [boulder])
      call keep(file, nf90_put_att(file%id, id, "flag_values", [(int(k, i1), k=1, size(statuses))]))
      call note(file, id, "flag_meanings", joined(statuses, " "))
      call keep(file, nf90_put_var(file%id, id, results%status(:n)))
      id = described(file, "boulder", "impacts", [boulder])
      call keep(file, nf90_put_var(file%id, id, results%impacts(:n)))
      do k = 3, size(boulder_counts)
         id = described(file, "count", trim(boulder_counts(k)), [integer ::])
         call keep(file, nf90_put_var(file%id, id, results%count(k)))
      end do
   end subroutine write_boulders

   subroutine write_lines(file, results, boulder)
      type(netcdf_file_t), intent(inout) :: file
      type(results_t), intent(in) :: results
      integer, intent(in) :: boulder
      integer :: line, id, k, l, n

      n = int(results%done)
      line = dimension(file, "line", size(results%line, 2, i8))
      do k = 1, size(line_fields)
         id = described(file, "line", trim(line_fields(k)), [boulder, line])
         do l = 1, size(results%line, 2)
            call keep(file, nf90_put_var(file%id, id, results%line(:n, l, k), start=[1, l], count=[n, 1]))
         end do
      end do
   end subroutine write_lines

   subroutine write_histograms(file, results)
      type(netcdf_file_t), intent(inout) :: file
      type(results_t), intent(in) :: results
      integer :: bin, id, k

      do k = 1, size(histogram_fields)
         bin = dimension(file, trim(histogram_fields(k))//"_bin", int(n_bins(k), i8))
         id = described(file, "histogram", trim(histogram_fields(k)), [bin])
         call keep(file, nf90_put_var(file%id, id, results%histogram(:n_bins(k), k)))
      end do
   end subroutine write_histograms

   subroutine write_trajectories(file, results)
      type(netcdf_file_t), intent(inout) :: file
      type(results_t), intent(in) :: results
      integer :: vertex, id, k

      if (size(results%vertex) == 0) return
      vertex = dimension(file, "trajectory_vertex", size(results%vertex, 1, i8))
      id = described(file, "vertex", "boulder", [vertex])
      call keep(file, nf90_put_var(file%id, id, results%vertex_boulder))
      do k = 1, size(vertex_fields)
         id = described(file, "vertex", trim(vertex_fields(k)), [vertex])
         call keep(file, nf90_put_var(file%id, id, results%vertex(:, k)))
      end do
   end subroutine write_trajectories

   !> The tallies of the cells that boulders reached, which add up over parts.
   subroutine write_tallies(file, results, tally)
      type(netcdf_file_t), intent(inout) :: file
      type(results_t), intent(in), target :: results
      type(tally_t), intent(in) :: tally
      integer(i4), pointer :: flat4(:)
      integer(i8), pointer :: flat8(:)
      real(sp), pointer :: flat(:)
      integer :: cell, id, k, n

      n = size(tally%cell)
      cell = dimension(file, "tally", size(tally%cell, kind=i8))
      id = tally_variable("cell", nf90_int64, [cell], "index of the cell, by rows from the north-west")
      call keep(file, nf90_put_var(file%id, id, tally%cell))
      associate (cells => size(results%counts, 1)*size(results%counts, 2, i8))
         if (size(results%counts) > 0) id = layers("counts", nf90_int, size(results%counts, 3))
         do k = 1, size(results%counts, 3)
            flat4(1:cells) => results%counts(:, :, k)
            call keep(file, nf90_put_var(file%id, id, flat4(tally%cell + 1), start=[1, k], count=[n, 1]))
         end do
         if (size(results%sums) > 0) id = layers("sums", nf90_int64, size(results%sums, 3))
         do k = 1, size(results%sums, 3)
            flat8(1:cells) => results%sums(:, :, k)
            call keep(file, nf90_put_var(file%id, id, flat8(tally%cell + 1), start=[1, k], count=[n, 1]))
         end do
         if (size(results%maxima) > 0) id = layers("maxima", nf90_float, size(results%maxima, 3))
         do k = 1, size(results%maxima, 3)
            flat(1:cells) => results%maxima(:, :, k)
            call keep(file, nf90_put_var(file%id, id, flat(tally%cell + 1), start=[1, k], count=[n, 1]))
         end do
         if (size(results%column) > 0) call write_classes(file, results, tally, cell)
      end associate
      if (size(results%stamp) > 0) call write_fed()

   contains

      integer function layers(name, kind, n)
         character(len=*), intent(in) :: name
         integer, intent(in) :: kind, n

         layers = tally_variable(name, kind, [cell, dimension(file, "tally_"//name//"_layer", int(n, i8))], &
                                 name//" of the maps, by layer")
      end function layers

      integer function tally_variable(name, kind, dims, long_name)
         character(len=*), intent(in) :: name, long_name
         integer, intent(in) :: kind, dims(:)

         tally_variable = variable(file, "tally_"//name, kind, dims, "1", long_name, "")
      end function tally_variable

      !> The cells to which partial sources contribute: other parts may have counted these sources there too.
      subroutine write_fed()
         integer :: fed

         fed = dimension(file, "tally_fed", size(tally%fed%cell, kind=i8))
         id = tally_variable("fed_cell", nf90_int64, [fed], "cell to which a source contributes that the part cuts")
         call keep(file, nf90_put_var(file%id, id, tally%fed%cell))
         id = tally_variable("fed_source", nf90_int, [fed], "number of that source")
         call keep(file, nf90_put_var(file%id, id, tally%fed%source))
         id = tally_variable("fed_boulders", nf90_int, [fed], "its boulders in the part")
         call keep(file, nf90_put_var(file%id, id, tally%fed%boulders))
      end subroutine write_fed
   end subroutine write_tallies

   !> Counts of classes, some cells at a time.
   subroutine write_classes(file, results, tally, cell)
      type(netcdf_file_t), intent(inout) :: file
      type(results_t), intent(in), target :: results
      type(tally_t), intent(in) :: tally
      integer, intent(in) :: cell  !! the dimension
      integer(i4), pointer :: column(:)
      integer(i4), allocatable :: some(:, :)
      integer :: id, k, first, last

      id = variable(file, "tally_classes", nf90_int, [dimension(file, "tally_class", int(results%plan%rows, i8)), cell], &
                    "1", "counts of classes", "")
      column(1:size(results%column)) => results%column
      do first = 1, size(tally%cell), block
         last = min(size(tally%cell), first + block - 1)
         allocate (some(results%plan%rows, first:last), source=0_i4)
         do k = first, last
            associate (own => column(tally%cell(k) + 1))
               if (own > 0) some(:, k) = results%bin_counts(:, own)
            end associate
         end do
         call keep(file, nf90_put_var(file%id, id, some, start=[1, first], count=shape(some)))
         deallocate (some)
      end do
   end subroutine write_classes

   !> Cells in which any tally is not zero, counted from 0 by rows.
   pure function reached_cells(results) result(cells)
      type(results_t), intent(in) :: results
      integer(i8), allocatable :: cells(:)
      integer(i8) :: n, turn
      integer :: i, j
      logical :: reached

      do turn = 1, 2  ! count them, then note them
         n = 0
         do j = 1, size(results%counts, 2)
            do i = 1, size(results%counts, 1)
               reached = any(results%counts(i, j, :) /= 0) .or. any(results%sums(i, j, :) /= 0) &
                         .or. any(results%maxima(i, j, :) > 0)
               if (size(results%column) > 0) reached = reached .or. results%column(i, j) > 0
               if (.not. reached) cycle
               n = n + 1
               if (turn == 2) cells(n) = (j - 1)*size(results%counts, 1, i8) + i - 1
            end do
         end do
         if (turn == 1) allocate (cells(n))
      end do
   end function reached_cells

   ! ---- from disk ----------------------------------------------------------------------------

   !> How many boulders a file of this layout holds; -1 if it is no such file.
   integer(i8) function boulders_in(name) result(n)
      character(len=*), intent(in) :: name
      type(netcdf_file_t) :: file
      type(error_t), allocatable :: error

      n = -1
      call open_netcdf(name, file, error)
      if (allocated(error)) return
      if (integer_of(file, "part_layout") == layout) &
         n = integer_of(file, "boulder_last") - integer_of(file, "boulder_first") + 1
      call close_netcdf(file)
   end function boulders_in

   !> Results go on from a part of the same run that begins where they do; any other, and one that is damaged, is
   !> refused.
   subroutine read_part(name, case, text, inputs, results, error)
      character(len=*), intent(in) :: name
      type(case_t), intent(in) :: case
      character(len=*), intent(in) :: text  !! of the case, as it is run
      type(inputs_t), intent(in) :: inputs
      type(results_t), intent(inout), target :: results
      type(error_t), allocatable, intent(out) :: error
      type(netcdf_file_t) :: file

      call open_netcdf(name, file, error)
      if (.not. allocated(error)) call check_run(file, text, inputs, results, error)
      if (allocated(error)) return
      call read_boulders(file, results)
      if (size(case%lines) > 0) call read_lines(file, results)
      call read_tallies(file, inputs, results)
      if (case%rebounds) call read_histograms(file, results)
      if (.not. sound(file)) then
         call fail_damaged(file, error)
         error%message = error%message//"; remove it to begin anew"
      end if
      call close_netcdf(file)
   end subroutine read_part

   !> It is of this run, and its boulders are the first of those to be done here.
   subroutine check_run(file, text, inputs, results, error)
      type(netcdf_file_t), intent(inout) :: file
      character(len=*), intent(in) :: text
      type(inputs_t), intent(in) :: inputs
      type(results_t), intent(inout) :: results
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: what, key
      integer(i8) :: first, last

      first = integer_of(file, "boulder_first")
      last = integer_of(file, "boulder_last")
      what = ""
      if (any(integers_of(file, "map_window", 4) /= window_of(results))) what = "window"
      if (text_of(file, nf90_global, sums_of(2)) /= inputs%decoded_checksums) what = trim(sums_of(2))
      if (text_of(file, nf90_global, sums_of(1)) /= inputs%input_checksums) what = trim(sums_of(1))
      if (first /= results%before + 1 .or. last > results%before + results%boulders .or. last < first &
          .or. integer_of(file, "boulders_asked") /= results%asked) what = "boulders"
      key = differing_key(text_of(file, nf90_global, "case"), text, of_arrays=.false.)
      if (key /= "") what = key
      if (text_of(file, nf90_global, "version") /= version) what = "version"
      if (integer_of(file, "part_layout") /= layout) what = "layout"
      if (what /= "") then
         call fail(error, file%name//": is of another run, its "//what//" differs; remove it, or run without --resume " &
                   //"elsewhere")
         return
      end if
      results%done = last - first + 1
      results%wall = real_of(file, "wall_seconds")
      results%cpu = real_of(file, "cpu_seconds")
      if (.not. (ieee_is_finite(results%wall) .and. ieee_is_finite(results%cpu))) then
         call mark_damaged(file, "wall_seconds")
      else if (min(results%wall, results%cpu) < 0) then
         call mark_damaged(file, "wall_seconds")
      end if
   end subroutine check_run

   subroutine read_boulders(file, results)
      type(netcdf_file_t), intent(inout) :: file
      type(results_t), intent(inout) :: results
      integer :: id, k, n

      n = int(results%done)
      do k = 1, size(boulder_fields)
         id = expected(file, trim(boulder_fields(k)), nf90_double, [n])
         if (.not. sound(file)) return
         call keep(file, nf90_get_var(file%id, id, results%boulder(:n, k)))
         if (.not. all(ieee_is_finite(results%boulder(:n, k)))) call mark_damaged(file, trim(boulder_fields(k)))
      end do
      id = expected(file, "status", nf90_byte, [n])
      if (sound(file)) call keep(file, nf90_get_var(file%id, id, results%status(:n)))
      if (sound(file) .and. any(results%status(:n) < 1 .or. results%status(:n) > size(statuses))) &
         call mark_damaged(file, "status")
      id = expected(file, "impacts", nf90_int, [n])
      if (sound(file)) call keep(file, nf90_get_var(file%id, id, results%impacts(:n)))
      if (sound(file) .and. any(results%impacts(:n) < 0)) call mark_damaged(file, "impacts")
      do k = 3, size(boulder_counts)
         id = expected(file, trim(boulder_counts(k)), nf90_int64, [integer ::])
         if (sound(file)) call keep(file, nf90_get_var(file%id, id, results%count(k)))
         if (results%count(k) < 0) call mark_damaged(file, trim(boulder_counts(k)))
      end do
   end subroutine read_boulders

   !> First crossings: numbers where there is a time, NaN elsewhere.
   subroutine read_lines(file, results)
      type(netcdf_file_t), intent(inout) :: file
      type(results_t), intent(inout) :: results
      integer, parameter :: time = findloc(line_fields, "time", dim=1)
      integer :: id, k, l, n

      n = int(results%done)
      do k = 1, size(line_fields)
         id = expected(file, name_of("line", line_fields(k)), nf90_double, [n, size(results%line, 2)])
         do l = 1, size(results%line, 2)
            if (.not. sound(file)) return
            call keep(file, nf90_get_var(file%id, id, results%line(:n, l, k), start=[1, l], count=[n, 1]))
         end do
      end do
      do k = 1, size(line_fields)
         associate (values => results%line(:n, :, k), crossed => .not. ieee_is_nan(results%line(:n, :, time)))
            if (any(ieee_is_finite(values) .neqv. crossed) .or. any(ieee_is_nan(values) .eqv. crossed)) &
               call mark_damaged(file, name_of("line", line_fields(k)))
         end associate
      end do
   end subroutine read_lines

   subroutine read_histograms(file, results)
      type(netcdf_file_t), intent(inout) :: file
      type(results_t), intent(inout) :: results
      integer :: id, k

      do k = 1, size(histogram_fields)
         id = expected(file, name_of("histogram", histogram_fields(k)), nf90_int64, [n_bins(k)])
         if (.not. sound(file)) return
         call keep(file, nf90_get_var(file%id, id, results%histogram(:n_bins(k), k)))
         if (any(results%histogram(:, k) < 0)) call mark_damaged(file, name_of("histogram", histogram_fields(k)))
      end do
   end subroutine read_histograms

   !> Tallies of cells, to their places in maps that are empty.
   subroutine read_tallies(file, inputs, results)
      type(netcdf_file_t), intent(inout) :: file
      type(inputs_t), intent(in) :: inputs
      type(results_t), intent(inout), target :: results
      integer(i4), pointer :: flat4(:)
      integer(i8), pointer :: flat8(:)
      real(sp), pointer :: flat(:)
      integer(i8), allocatable :: cell(:), sums(:)
      integer(i4), allocatable :: counts(:)
      real(sp), allocatable :: maxima(:)
      integer(i8) :: cells
      integer :: id, k, n, status

      cells = size(results%counts, 1)*size(results%counts, 2, i8)
      n = length_of(file, "tally")
      if (n < 0 .or. n > cells) call mark_damaged(file, "tally")
      id = expected(file, "tally_cell", nf90_int64, [n])
      if (.not. sound(file)) return
      allocate (cell(n), sums(n), counts(n), maxima(n), stat=status)
      if (status /= 0) call mark_damaged(file, "(no memory) tally")
      if (.not. sound(file)) return
      call keep(file, nf90_get_var(file%id, id, cell))
      if (any(cell < 0 .or. cell >= cells) .or. any(cell(2:) <= cell(:n - 1))) call mark_damaged(file, "tally_cell")
      if (size(results%counts) > 0) id = expected(file, "tally_counts", nf90_int, [n, size(results%counts, 3)])
      do k = 1, size(results%counts, 3)
         if (sound(file)) call keep(file, nf90_get_var(file%id, id, counts, start=[1, k], count=[n, 1]))
         if (.not. sound(file)) return
         if (any(counts < 0)) call mark_damaged(file, "tally_counts")
         flat4(1:cells) => results%counts(:, :, k)
         flat4(cell + 1) = counts
      end do
      if (size(results%sums) > 0) id = expected(file, "tally_sums", nf90_int64, [n, size(results%sums, 3)])
      do k = 1, size(results%sums, 3)
         if (sound(file)) call keep(file, nf90_get_var(file%id, id, sums, start=[1, k], count=[n, 1]))
         if (.not. sound(file)) return
         if (any(sums < 0)) call mark_damaged(file, "tally_sums")
         flat8(1:cells) => results%sums(:, :, k)
         flat8(cell + 1) = sums
      end do
      if (size(results%maxima) > 0) id = expected(file, "tally_maxima", nf90_float, [n, size(results%maxima, 3)])
      do k = 1, size(results%maxima, 3)
         if (sound(file)) call keep(file, nf90_get_var(file%id, id, maxima, start=[1, k], count=[n, 1]))
         if (.not. sound(file)) return
         if (.not. all(ieee_is_finite(maxima))) call mark_damaged(file, "tally_maxima")
         flat(1:cells) => results%maxima(:, :, k)
         flat(cell + 1) = maxima
      end do
      if (size(results%column) > 0) call read_classes(file, results, cell)
      if (size(results%stamp) > 0) call read_fed(file, inputs, results)
   end subroutine read_tallies

   !> Each cell gets a column of counts of classes.
   subroutine read_classes(file, results, cell)
      type(netcdf_file_t), intent(inout) :: file
      type(results_t), intent(inout), target :: results
      integer(i8), intent(in) :: cell(:)
      integer(i4), pointer :: column(:)
      integer :: id, k, n

      n = size(cell)
      if (n > size(results%bin_counts, 2)) call mark_damaged(file, "(no memory) tally_classes")
      id = expected(file, "tally_classes", nf90_int, [results%plan%rows, n])
      if (.not. sound(file)) return
      call keep(file, nf90_get_var(file%id, id, results%bin_counts(:, :n)))
      if (any(results%bin_counts(:, :n) < 0)) call mark_damaged(file, "tally_classes")
      column(1:size(results%column)) => results%column
      column(cell + 1) = [(int(k, i4), k=1, n)]
      results%columns = n
   end subroutine read_classes

   !> The marks of partial sources, which go on to be counted.
   subroutine read_fed(file, inputs, results)
      type(netcdf_file_t), intent(inout) :: file
      type(inputs_t), intent(in) :: inputs
      type(results_t), intent(inout), target :: results
      type(maps_t) :: maps
      type(contributing_t) :: fed
      integer(i8) :: cells
      integer :: id, k, n, status

      n = length_of(file, "tally_fed")
      cells = size(results%counts, 1)*size(results%counts, 2, i8)
      if (n < 0 .or. n > 2*cells) call mark_damaged(file, "tally_fed")
      id = expected(file, "tally_fed_cell", nf90_int64, [n])
      if (.not. sound(file)) return
      allocate (fed%cell(n), fed%source(n), fed%boulders(n), stat=status)
      if (status /= 0) call mark_damaged(file, "(no memory) tally_fed")
      if (sound(file)) call keep(file, nf90_get_var(file%id, id, fed%cell))
      id = expected(file, "tally_fed_source", nf90_int, [n])
      if (sound(file)) call keep(file, nf90_get_var(file%id, id, fed%source))
      id = expected(file, "tally_fed_boulders", nf90_int, [n])
      if (sound(file)) call keep(file, nf90_get_var(file%id, id, fed%boulders))
      if (sound(file)) call check_fed(file, inputs, results, fed, cells)
      if (.not. sound(file)) return
      maps = map_tallies(results, [1, 1])
      call settle(maps, inputs%scene%release, fed, -1)
      do k = 1, n
         associate (layer => merge(2, 1, fed%source(k) == results%head), nx => size(results%stamp, 1, i8))
            results%stamp(mod(fed%cell(k), nx) + 1, fed%cell(k)/nx + 1, layer) = fed%source(k)
         end associate
      end do
   end subroutine read_fed

   !> They are sources that the boulders done cut, with as many boulders as they have among them, and each has its
   !> cells in order.
   subroutine check_fed(file, inputs, results, fed, cells)
      type(netcdf_file_t), intent(inout) :: file
      type(inputs_t), intent(in) :: inputs
      type(results_t), intent(in) :: results
      type(contributing_t), intent(in) :: fed
      integer(i8), intent(in) :: cells
      integer(i8), allocatable :: sources(:)
      integer(i8) :: first, last, own
      integer :: k, n
      logical :: good

      first = results%before + 1
      last = results%before + results%done
      sources = partial_sources(inputs%scene%release, first, last)
      good = all(fed%cell >= 0 .and. fed%cell < cells)
      n = size(fed%cell)
      good = good .and. all(fed%source(2:) > fed%source(:n - 1) &
                            .or. (fed%source(2:) == fed%source(:n - 1) .and. fed%cell(2:) > fed%cell(:n - 1)))
      do k = 1, size(sources)
         own = boulders_within(inputs%scene%release, sources(k), first, last)
         n = n - count(fed%source == sources(k) .and. fed%boulders == own)
      end do
      if (.not. good .or. n /= 0) call mark_damaged(file, "tally_fed_cell")
   end subroutine check_fed
end module rockfall_part_file
