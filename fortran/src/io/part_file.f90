! SPDX-License-Identifier: BSD-3-Clause
!> Part file (docs/files.md): results of some boulders of a run, with tallies that add up to those of all. Checkpoints,
!> results of shards and results of this program are part files; `rockfall` reads and writes them too.
module rockfall_part_file
   use, intrinsic :: iso_c_binding, only: c_associated, c_f_pointer
   use, intrinsic :: ieee_arithmetic, only: ieee_is_nan, ieee_is_finite
   use netcdf, only: nf90_global, nf90_copy_att, nf90_inq_attname, nf90_inq_varid, nf90_inquire_variable, &
                     nf90_put_att, nf90_strerror, nf90_byte, nf90_int, nf90_int64, nf90_float, nf90_double
   use rockfall_kinds, only: wp, sp, i1, i4, i8
   use rockfall_error, only: error_t, fail
   use rockfall_text, only: joined
   use rockfall_version, only: version
   use rockfall_grid, only: grid_t
   use rockfall_system, only: replace_file, remove_file
   use rockfall_netcdf_file, only: netcdf_file_t, axis_t, definition_t, open_netcdf, create_netcdf, close_netcdf, &
                                   record_status, is_ok, mark_damaged, fail_damaged, transfer, length_of, text_of, &
                                   integers_of, real_of
   use rockfall_variables, only: variable_of, stored_as, name_in_files, layout => part_layout, line_fields, &
                                 statuses
   use rockfall_barrier, only: passed_over
   use rockfall_ground, only: ground_t
   use rockfall_grounds, only: model_names
   use rockfall_case, only: case_t
   use rockfall_case_file, only: differing_key
   use rockfall_scene_file, only: inputs_t
   use rockfall_samples, only: base_bits
   use rockfall_line_samples, only: layout_t
   use rockfall_state_table, only: array_t, table_t
   use rockfall_run_state, only: run_t, arrays_of, rows_of, settle_partial_sources, restore_sources
   implicit none
   private
   public :: write_part, read_part, boulders_in

   character(len=*), parameter :: types(*) = ["i1", "i4", "i8", "f4", "f8"]  !! as in `stored_as`
   integer, parameter :: kinds(*) = [nf90_byte, nf90_int, nf90_int64, nf90_float, nf90_double]

contains

   !> Put the boulders done into a file, whole and on disk before it takes its name, by way of `part`.
   subroutine write_part(name, part, case, text, inputs, run, error)
      character(len=*), intent(in) :: name, part
      type(case_t), intent(in) :: case
      character(len=*), intent(in) :: text  !! of the case, with options of the command line
      type(inputs_t), intent(in) :: inputs
      type(run_t), intent(inout), target :: run
      type(error_t), allocatable, intent(out) :: error
      type(netcdf_file_t) :: file
      integer(i8), allocatable :: cell(:)
      logical :: done

      call create_netcdf(part, file)
      if (is_ok(file)) then
         call describe(file, case, text, inputs, run)
         call settle_partial_sources(run, inputs%scene%release, 1)
         cell = reached_cells(run)
         call pass_arrays(file, run, cell)
         call settle_partial_sources(run, inputs%scene%release, -1)
      end if
      call close_netcdf(file)
      done = is_ok(file)
      if (done) done = replace_file(part, name)
      if (done) return
      if (is_ok(file)) then
         call fail(error, name//": cannot be replaced; is it open in another program? The new file is "//part)
      else
         done = remove_file(part)
         call fail(error, name//": cannot be written: "//trim(nf90_strerror(file%status))//" (the disk may be full)")
      end if
   end subroutine write_part

   !> Write the description of the part; the grid mapping of the terrain is copied from the scene file.
   subroutine describe(file, case, text, inputs, run)
      type(netcdf_file_t), intent(inout) :: file
      type(case_t), intent(in) :: case
      character(len=*), intent(in) :: text
      type(inputs_t), intent(in) :: inputs
      type(run_t), intent(in) :: run
      character(len=128) :: name
      integer(i8) :: whole
      integer :: crs(1), id, k, n

      crs = 0
      call transfer(file, definition_t("crs", nf90_int, "1", "coordinate reference system"), [axis_t ::], crs)
      n = 0
      call record_status(file, nf90_inq_varid(file%id, "crs", id))
      call record_status(file, nf90_inquire_variable(inputs%file%id, inputs%crs, natts=n))
      do k = 1, n
         call record_status(file, nf90_inq_attname(inputs%file%id, inputs%crs, k, name))
         if (name == "_FillValue") cycle
         call record_status(file, nf90_copy_att(inputs%file%id, inputs%crs, trim(name), file%id, id))
      end do
      whole = merge(1, 0, run%done == run%total)
      associate (grid => inputs%arrays%grid, last => run%before + run%done)
         call record_status(file, nf90_put_att(file%id, nf90_global, "Conventions", "CF-1.11"))
         call record_status(file, nf90_put_att(file%id, nf90_global, "part_layout", layout))
         call record_status(file, nf90_put_att(file%id, nf90_global, "title", case%title))
         call record_status(file, nf90_put_att(file%id, nf90_global, "source", "rockfall "//version &
                                      //", stochastic impact model of Bourrier et al. (2009)"))
         call record_status(file, nf90_put_att(file%id, nf90_global, "version", version))
         call record_status(file, nf90_put_att(file%id, nf90_global, "case", text))
         call record_status(file, nf90_put_att(file%id, nf90_global, "case_file", inputs%case_file))
         call record_status(file, nf90_put_att(file%id, nf90_global, "impact_set", case%sets))
         call record_status(file, nf90_put_att(file%id, nf90_global, "impact_set_checksum", inputs%impact_set_checksum))
         call record_status(file, nf90_put_att(file%id, nf90_global, "input_checksums", inputs%input_checksums))
         call record_status(file, nf90_put_att(file%id, nf90_global, "decoded_checksums", inputs%decoded_checksums))
         if (inputs%input_warnings /= "") &
            call record_status(file, nf90_put_att(file%id, nf90_global, "input_warnings", inputs%input_warnings))
         if (inputs%dams /= "") call record_status(file, nf90_put_att(file%id, nf90_global, "dams", inputs%dams))
         if (inputs%stands /= "") call record_status(file, nf90_put_att(file%id, nf90_global, "stands", inputs%stands))
         call record_status(file, nf90_put_att(file%id, nf90_global, "seed", case%seed))
         call record_status(file, nf90_put_att(file%id, nf90_global, "boulder_first", run%before + 1))
         call record_status(file, nf90_put_att(file%id, nf90_global, "boulder_last", last))
         call record_status(file, nf90_put_att(file%id, nf90_global, "boulders_requested", run%total))
         call record_status(file, nf90_put_att(file%id, nf90_global, "complete", whole))
         call record_status(file, nf90_put_att(file%id, nf90_global, "threads", int(run%threads, i8)))
         call record_status(file, nf90_put_att(file%id, nf90_global, "date_created", local_time()))
         call record_status(file, nf90_put_att(file%id, nf90_global, "wall_seconds", run%wall))
         call record_status(file, nf90_put_att(file%id, nf90_global, "cpu_seconds", run%cpu))
         call record_status(file, nf90_put_att(file%id, nf90_global, "terrain_cells", [grid%nx, grid%ny]))
         call record_status(file, nf90_put_att(file%id, nf90_global, "map_window", window_of(run)))
         if (inputs%feature_names /= "") &
            call record_status(file, nf90_put_att(file%id, nf90_global, "source_features", inputs%feature_names))
         if (allocated(inputs%scene%grounds)) call describe_grounds(file, inputs%scene%grounds)
      end associate
   end subroutine describe

   !> Current date and time with time zone (ISO 8601).
   function local_time() result(text)
      character(len=25) :: text
      character(len=8) :: date
      character(len=10) :: time
      character(len=5) :: zone

      call date_and_time(date, time, zone)
      text = date(1:4)//"-"//date(5:6)//"-"//date(7:8)//"T"//time(1:2)//":"//time(3:4)//":"//time(5:6) &
             //zone(1:3)//":"//zone(4:5)
   end function local_time

   !> Write names and models of the ground types, one line each.
   subroutine describe_grounds(file, grounds)
      type(netcdf_file_t), intent(inout) :: file
      type(ground_t), intent(in) :: grounds(:)
      character(len=:), allocatable :: names, models
      integer :: k

      names = grounds(1)%name
      models = trim(model_names(grounds(1)%classical%model))
      do k = 2, size(grounds)
         names = names//new_line(names)//grounds(k)%name
         models = models//new_line(names)//trim(model_names(grounds(k)%classical%model))
      end do
      call record_status(file, nf90_put_att(file%id, nf90_global, "grounds", names))
      call record_status(file, nf90_put_att(file%id, nf90_global, "ground_models", models))
   end subroutine describe_grounds

   !> 0-based first column and row, and numbers of columns and rows of the maps.
   pure function window_of(run) result(window)
      type(run_t), intent(in) :: run
      integer :: window(4)

      window = [run%at - 1, run%nodes]
   end function window_of

   !> Cells in which any tally is not zero, counted from 0 by rows.
   pure function reached_cells(run) result(cells)
      type(run_t), intent(in) :: run
      integer(i8), allocatable :: cells(:)
      logical, allocatable :: reached(:, :)
      integer(i8) :: k

      reached = any(run%counts /= 0, dim=3) .or. any(run%sums /= 0, dim=3) .or. any(run%maxima > 0, dim=3)
      if (size(run%column) > 0) reached = reached .or. run%column > 0
      cells = pack([(k, k=0, size(reached, kind=i8) - 1)], reshape(reached, [size(reached)]))
   end function reached_cells

   ! ---- write and read -----------------------------------------------------------------------

   !> Describe a variable from its row of the table.
   pure type(definition_t) function described(group, name) result(definition)
      character(len=*), intent(in) :: group, name

      associate (row => variable_of(group, name))
         definition = definition_t(name_in_files(row), kinds(findloc(types, stored_as(row), dim=1)), row%units, &
                                   row%long_name, row%comment)
         if (group /= "histogram") return
         definition%units = "1"
         definition%long_name = "rebounds by "//row%long_name
      end associate
   end function described

   !> Transfer all arrays of a run: rows of the boulders done, maps in some cells, and samples, of which only non-empty
   !> bins.
   subroutine pass_arrays(file, run, cell)
      type(netcdf_file_t), intent(inout) :: file
      type(run_t), intent(inout), target :: run
      integer(i8), intent(inout) :: cell(:)  !! 0-based, in order
      type(table_t) :: table
      type(axis_t) :: cells
      integer :: k

      table = arrays_of(run)
      cells = axis_t("tally", size(cell, kind=i8))
      call transfer(file, described("tally", "cell"), [cells], cell)
      if (.not. is_ok(file) .or. .not. in_order(file, cell, run)) return
      do k = 1, size(table%row)
         associate (row => table%row(k))
            if (row%variable%group == "work") then
               cycle
            else if (row%variable%name == "bin_counts") then
               call pass_bin_counts(file, run, cell, cells)
            else if (row%axis(1) == "x") then
               call pass_stack(file, row, cell, cells)
            else
               call pass_array(file, row, rows_of(run))
            end if
         end associate
      end do
      if (allocated(run%number)) call pass_bins(file, "", run%samples%bins, size(run%samples%bins, kind=i8))
      if (allocated(run%number)) call pass_bins(file, "group_", run%samples%groups, size(run%samples%groups, kind=i8))
   end subroutine pass_arrays

   !> Transfer an array; of rows only the first ones.
   subroutine pass_array(file, row, rows)
      type(netcdf_file_t), intent(inout) :: file
      type(array_t), intent(in) :: row
      integer(i8), intent(in) :: rows
      type(axis_t), allocatable :: axes(:)
      type(definition_t) :: definition
      integer(i1), target :: none(0)
      integer(i1), pointer, contiguous :: bytes(:)
      integer(i8) :: step
      integer :: id, k

      definition = described(row%variable%group, row%variable%name)
      axes = [(axis_t(row%axis(k), row%length(k)), k=1, row%rank)]
      step = bytes_of(row)*row%length(1)
      bytes => none
      if (c_associated(row%at)) call c_f_pointer(row%at, bytes, [step*product(row%length(2:))])
      if (row%axis(1) == "boulder") axes%length = [rows, row%length(2:row%rank)]
      if (row%axis(1) == "boulder" .and. row%rank == 2) then  ! more rows are allocated than used
         do k = 1, int(row%length(2))
            call transfer(file, definition, axes, bytes((k - 1)*step + 1:), k)
         end do
      else
         call transfer(file, definition, axes, bytes)
      end if
      if (row%variable%name /= "status" .or. .not. file%writes .or. .not. is_ok(file)) return
      call record_status(file, nf90_inq_varid(file%id, "status", id))
      call record_status(file, nf90_put_att(file%id, id, "flag_values", [(int(k, i1), k=1, size(statuses))]))
      call record_status(file, nf90_put_att(file%id, id, "flag_meanings", joined(statuses, " ")))
   end subroutine pass_array

   pure integer function bytes_of(row)
      type(array_t), intent(in) :: row

      bytes_of = merge(8, merge(4, 1, row%kind(2:) == "4"), row%kind(2:) == "8")
   end function bytes_of

   !> Transfer a stack of maps: the values of the cells in each layer, as 32-bit words.
   subroutine pass_stack(file, row, cell, cells)
      type(netcdf_file_t), intent(inout) :: file
      type(array_t), intent(in) :: row
      integer(i8), intent(in) :: cell(:)
      type(axis_t), intent(in) :: cells
      integer(i4), pointer :: value(:, :, :)
      integer(i4), allocatable :: values(:, :)
      integer :: k

      call c_f_pointer(row%at, value, [int(bytes_of(row)/4, i8), product(row%length(:2)), row%length(3)])
      do k = 1, size(value, 3)
         values = value(:, cell + 1, k)
         call transfer(file, described("tally", row%variable%name), [cells, axis_t(row%axis(3), row%length(3))], &
                       values, k)
         value(:, cell + 1, k) = values
      end do
   end subroutine pass_stack

   !> Transfer bin counts of all cells.
   subroutine pass_bin_counts(file, run, cell, cells)
      type(netcdf_file_t), intent(inout) :: file
      type(run_t), intent(inout), target :: run
      integer(i8), intent(in) :: cell(:)
      type(axis_t), intent(in) :: cells
      integer(i4), pointer :: column(:)
      integer(i4), allocatable :: counts(:, :)
      integer :: k, status

      column(1:size(run%column)) => run%column
      allocate (counts(run%plan%rows, size(cell)), source=0_i4, stat=status)
      if (status /= 0 .or. size(cell) > size(run%bin_counts, 2)) then
         call mark_damaged(file, "(no memory) tally_bin_counts")
         return
      end if
      do k = 1, size(cell)
         if (column(cell(k) + 1) > 0) counts(:, k) = run%bin_counts(:, column(cell(k) + 1))
      end do
      call transfer(file, described("tally", "bin_counts"), [axis_t("tally_bin", int(run%plan%rows, i8)), cells], &
                    counts)
      if (file%writes .or. .not. is_ok(file)) return
      run%bin_counts(:, :size(cell)) = counts
      column(cell + 1) = [(int(k, i4), k=1, size(cell))]
      run%columns = size(cell)
   end subroutine pass_bin_counts

   !> Transfer the counts of samples: 0-based indices and contents of the non-empty bins.
   subroutine pass_bins(file, before, flat, n)
      type(netcdf_file_t), intent(inout) :: file
      character(len=*), intent(in) :: before
      integer(i8), intent(in) :: n
      integer(i4), intent(inout) :: flat(n)
      integer(i8), allocatable :: bin(:)
      integer(i4), allocatable :: counts(:)
      type(axis_t) :: entry
      integer(i8) :: k
      integer :: status

      entry = axis_t("sample_"//before//"entry", count(flat /= 0, kind=i8))
      if (.not. file%writes) entry%length = length_of(file, trim(entry%name))
      status = merge(1, 0, entry%length < 0 .or. entry%length > n)
      if (status == 0) allocate (bin(entry%length), counts(entry%length), stat=status)
      if (status /= 0) call mark_damaged(file, "sample_"//before//"bin")
      if (.not. is_ok(file)) return
      if (file%writes) then
         bin = pack([(k, k=0, n - 1)], flat /= 0)
         counts = flat(bin + 1)
      end if
      call transfer(file, described("sample", before//"bin"), [entry], bin)
      call transfer(file, described("sample", before//"count"), [entry], counts)
      if (file%writes .or. .not. is_ok(file)) return
      if (any(bin < 0 .or. bin >= n) .or. any(counts < 1) .or. any(bin(2:) <= bin(:size(bin) - 1))) &
         call mark_damaged(file, "sample_"//before//"bin")
      if (is_ok(file)) flat(bin + 1) = counts
   end subroutine pass_bins

   ! ---- read ---------------------------------------------------------------------------------

   !> Number of boulders in a file of this layout; -1 if it is not such a file.
   integer(i8) function boulders_in(name) result(n)
      character(len=*), intent(in) :: name
      type(netcdf_file_t) :: file
      type(error_t), allocatable :: error

      n = -1
      call open_netcdf(name, file, error)
      if (allocated(error)) return
      if (integer_of(file, "part_layout") == layout .and. integer_of(file, "boulder_first") >= 1) &
         n = max(-1_i8, integer_of(file, "boulder_last") - integer_of(file, "boulder_first") + 1)
      call close_netcdf(file)
   end function boulders_in

   integer(i8) function integer_of(file, name) result(value)
      type(netcdf_file_t), intent(in) :: file
      character(len=*), intent(in) :: name

      value = sum(integers_of(file, name, 1))
   end function integer_of

   !> Read a part from which a run continues; it must start where the run starts. Others, and damaged ones, are
   !> rejected.
   subroutine read_part(name, text, inputs, run, error)
      character(len=*), intent(in) :: name
      character(len=*), intent(in) :: text  !! of the case, with options of the command line
      type(inputs_t), intent(in) :: inputs
      type(run_t), intent(inout), target :: run
      type(error_t), allocatable, intent(out) :: error
      type(netcdf_file_t) :: file
      type(layout_t) :: layout
      integer(i8), allocatable :: number(:), cell(:)
      logical :: good

      call open_netcdf(name, file, error)
      if (.not. allocated(error)) call check_run(file, text, inputs, run, error)
      if (allocated(error)) return
      if (allocated(run%number)) number = run%number
      layout = run%layout
      call make_room(file, run, cell)
      if (is_ok(file)) call pass_arrays(file, run, cell)
      if (is_ok(file) .and. allocated(number)) then
         if (any(number /= run%number)) call mark_damaged(file, "boulder")
         if (any(layout%part_last /= run%layout%part_last)) call mark_damaged(file, "sample_part_last")
         if (any(layout%group_part /= run%layout%group_part)) call mark_damaged(file, "sample_group_part")
         call check_samples(file, run)
      end if
      if (is_ok(file)) call check_arrays(file, inputs%arrays%grid, run)
      if (is_ok(file) .and. allocated(run%shared%cell)) then
         call restore_sources(run, inputs%scene%release, good)
         if (.not. good) call mark_damaged(file, "tally_shared_cell")
      end if
      if (.not. is_ok(file)) then
         call fail_damaged(file, error)
         error%message = error%message//"; remove it to begin anew"
      end if
      call close_netcdf(file)
   end subroutine read_part

   !> Check that the file belongs to this run, and that its boulders are the first to be done here.
   subroutine check_run(file, text, inputs, run, error)
      type(netcdf_file_t), intent(inout) :: file
      character(len=*), intent(in) :: text
      type(inputs_t), intent(in) :: inputs
      type(run_t), intent(inout) :: run
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: what, key
      integer(i8) :: first, last, total

      first = integer_of(file, "boulder_first")
      last = integer_of(file, "boulder_last")
      total = integer_of(file, "boulders_requested")
      key = differing_key(text_of(file, nf90_global, "case"), text, of_arrays=.false.)
      what = ""
      if (any(integers_of(file, "map_window", 4) /= window_of(run))) what = "window"
      if (text_of(file, nf90_global, "decoded_checksums") /= inputs%decoded_checksums) what = "decoded_checksums"
      if (text_of(file, nf90_global, "input_checksums") /= inputs%input_checksums) what = "input_checksums"
      if (first /= run%before + 1 .or. last > run%before + run%boulders .or. last < first .or. total /= run%total) &
         what = "boulders"
      if (key /= "") what = key
      if (text_of(file, nf90_global, "version") /= version) what = "version"
      if (integer_of(file, "part_layout") /= layout) what = "layout"
      if (what /= "") then
         call fail(error, file%name//": is of another run, its "//what//" differs; remove it, or run without " &
                   //"--resume elsewhere")
         return
      end if
      run%done = last - first + 1
      run%wall = real_of(file, "wall_seconds")
      run%cpu = real_of(file, "cpu_seconds")
      if (.not. (ieee_is_finite(run%wall) .and. ieee_is_finite(run%cpu))) then
         call mark_damaged(file, "wall_seconds")
      else if (min(run%wall, run%cpu) < 0) then
         call mark_damaged(file, "wall_seconds")
      end if
   end subroutine check_run

   !> Values are such as a run can have.
   subroutine check_arrays(file, grid, run)
      type(netcdf_file_t), intent(inout) :: file
      type(grid_t), intent(in) :: grid
      type(run_t), intent(in), target :: run
      integer, parameter :: time = findloc(line_fields, "time", dim=1)
      type(table_t) :: table
      integer :: k

      table = arrays_of(run)
      do k = 1, size(table%row)
         associate (row => table%row(k))
            if (any(row%variable%group == ["work  ", "sample", "kept  "]) .or. product(row%length) == 0) cycle
            if (.not. is_possible(row)) call mark_damaged(file, name_in_files(row%variable))
         end associate
      end do

   contains

      logical function is_possible(row) result(good)
         type(array_t), intent(in) :: row
         integer(i1), pointer, contiguous :: i1_values(:, :)
         integer(i4), pointer, contiguous :: i4_values(:, :)
         integer(i8), pointer, contiguous :: i8_values(:)
         real(sp), pointer, contiguous :: f4_values(:)
         real(wp), pointer, contiguous :: f8_values(:, :)
         integer(i8) :: shape(2), n

         shape = [row%length(1), product(row%length(2:))]
         n = shape(1)
         if (row%axis(1) == "boulder") n = rows_of(run)
         good = .true.
         select case (row%kind)
         case ("i1")
            call c_f_pointer(row%at, i1_values, shape)
            if (row%variable%name == "status") &
               good = all(i1_values(:n, :) >= 1 .and. i1_values(:n, :) <= size(statuses))
            if (row%variable%name == "outcome") good = all(i1_values(:n, :) >= 0 .and. i1_values(:n, :) <= passed_over)
         case ("i4")
            call c_f_pointer(row%at, i4_values, shape)
            good = all(i4_values(:n, :) >= merge(1, 0, any(row%variable%name == ["source        ", "source_feature"])))
         case ("i8")
            call c_f_pointer(row%at, i8_values, [product(row%length)])
            good = all(i8_values >= 0)
         case ("f4")
            call c_f_pointer(row%at, f4_values, [product(row%length)])
            good = all(ieee_is_finite(f4_values))
         case ("f8")
            call c_f_pointer(row%at, f8_values, shape)
            if (any(row%variable%group == ["line    ", "fragment"])) then
               associate (crossed => .not. ieee_is_nan(run%line(:n, :, time)))
                  good = all(ieee_is_finite(f8_values(:n, :)) .eqv. crossed) &
                         .and. all(ieee_is_nan(f8_values(:n, :)) .neqv. crossed)
               end associate
            else
               good = all(ieee_is_finite(f8_values(:n, 1)))
               if (good .and. row%variable%group == "boulder") &
                  good = .not. is_beyond(row%variable%name, f8_values(:n, 1), grid)
            end if
         end select
      end function is_possible
   end subroutine check_arrays

   !> Check that boulders have volumes, and lie on the terrain (like out_of_range in
   !> python/rockfall/result/validate.py).
   pure logical function is_beyond(name, values, grid)
      character(len=*), intent(in) :: name
      real(wp), intent(in) :: values(:)
      type(grid_t), intent(in) :: grid

      select case (name)
      case ("volume"); is_beyond = any(values <= 0)
      case ("start_x", "stop_x"); is_beyond = any(values < grid%west .or. values > grid%west + grid%nx*grid%cell)
      case ("start_y", "stop_y"); is_beyond = any(values < grid%north - grid%ny*grid%cell .or. values > grid%north)
      case ("start_z", "stop_z"); is_beyond = .false.
      case default; is_beyond = any(values < 0)  ! lengths, times, speeds
      end select
   end function is_beyond

   subroutine check_samples(file, run)
      type(netcdf_file_t), intent(inout) :: file
      type(run_t), intent(in) :: run

      associate (sums => run%samples%sums, ended => run%samples%ended)
         if (any(sums(2:, :, :, :) < 0) .or. any(shiftr(sums(2:4:2, :, :, :), base_bits) /= 0)) &
            call mark_damaged(file, "sample_sums")
         if (any(ended < 0) .or. sum(ended) /= run%done) call mark_damaged(file, "sample_ended")
      end associate
      if (.not. are_heaps(run%samples%largest)) call mark_damaged(file, "sample_largest")
   end subroutine check_samples

   !> Return whether each column is a heap of numbers, with -1 for none; sorted columns are heaps.
   pure logical function are_heaps(largest)
      real(wp), intent(in) :: largest(:, :, :)
      integer :: k

      are_heaps = all(ieee_is_finite(largest)) .and. all(largest >= 0 .or. largest <= -1)
      do k = 2, size(largest, 1)
         are_heaps = are_heaps .and. all(largest(k, :, :) >= largest(k/2, :, :))
      end do
   end function are_heaps

   !> Allocate memory for what is to be read of cells.
   subroutine make_room(file, run, cell)
      type(netcdf_file_t), intent(inout) :: file
      type(run_t), intent(inout) :: run
      integer(i8), allocatable, intent(out) :: cell(:)
      integer(i8) :: cells
      integer :: n, shared, status

      cells = product(int(run%nodes, i8))
      n = length_of(file, "tally")
      shared = merge(length_of(file, "tally_shared"), 0, size(run%last_source) > 0)
      if (n < 0 .or. n > cells) call mark_damaged(file, "tally_cell")
      if (shared < 0 .or. shared > 2*cells) call mark_damaged(file, "tally_shared_cell")
      if (.not. is_ok(file)) return
      allocate (cell(n), stat=status)
      if (status == 0 .and. size(run%last_source) > 0) &
         allocate (run%shared%cell(shared), run%shared%source(shared), run%shared%boulders(shared), stat=status)
      if (status /= 0) call mark_damaged(file, "(no memory) tally_cell")
   end subroutine make_room

   !> Return whether cells are valid cells of the maps, in order.
   logical function in_order(file, cell, run)
      type(netcdf_file_t), intent(inout) :: file
      integer(i8), intent(in) :: cell(:)
      type(run_t), intent(in) :: run

      in_order = all(cell >= 0 .and. cell < product(int(run%nodes, i8)))
      in_order = in_order .and. all(cell(2:) > cell(:size(cell) - 1))
      if (.not. in_order) call mark_damaged(file, "tally_cell")
   end function in_order
end module rockfall_part_file
