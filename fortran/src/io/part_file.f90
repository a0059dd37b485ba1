! SPDX-License-Identifier: BSD-3-Clause
!> Part file (docs/part_file.md): results for a range of a run's boulders, with additive tallies. Checkpoints, shards,
!> and results of the standalone program are part files; `rockfall` reads and writes them too.
module rockfall_part_file
   use, intrinsic :: iso_c_binding, only: c_associated, c_f_pointer
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite, ieee_quiet_nan, ieee_value
   use netcdf, only: nf90_global, nf90_copy_att, nf90_inq_attname, nf90_inq_varid, nf90_inquire_variable, &
                     nf90_put_att, nf90_strerror, nf90_byte, nf90_int, nf90_int64, nf90_float, nf90_double
   use rockfall_kinds, only: wp, i1, i8
   use rockfall_error, only: error_t, fail
   use rockfall_text, only: joined
   use rockfall_version, only: version
   use rockfall_system, only: replace_file, remove_file
   use rockfall_netcdf_file, only: netcdf_file_t, axis_t, definition_t, open_netcdf, create_netcdf, close_netcdf, &
                                   record_status, is_ok, mark_damaged, fail_damaged, transfer, define, write_rows, &
                                   length_of, text_of, &
                                   integers_of, real_of
   use rockfall_variables, only: variable_of, stored_as, name_in_files, layout => part_layout, statuses, &
                                 outcomes
   use rockfall_impact_table, only: impact_table_t, largest_block
   use rockfall_block_shape, only: block_shapes
   use rockfall_ground, only: ground_t
   use rockfall_scene_type, only: n_grounds
   use rockfall_grounds, only: model_names
   use rockfall_case, only: case_t
   use rockfall_same_run, only: identity_t, difference, keys_of
   use rockfall_scene_file, only: inputs_t
   use rockfall_state_table, only: array_t, table_t
   use rockfall_run_state, only: run_t, arrays_of, rows_of, settle_run, restore_run, add_crossing_arrays
   use rockfall_crossing_rows, only: crossing_rows_t
   use rockfall_spilled_crossings, only: spilled_crossings_t
   use rockfall_part, only: part_t, part_lengths_t, pack_part, make_room, unpack_part, part_arrays
   implicit none
   private
   public :: write_part, read_part, is_finished, row_bytes, boulders_in

   character(len=*), parameter :: types(*) = ["i1", "i4", "i8", "f4", "f8"]  !! names of types in `stored_as`
   integer, parameter :: kinds(*) = [nf90_byte, nf90_int, nf90_int64, nf90_float, nf90_double]

contains

   !> Write the completed boulders to the file `part`, which is renamed to `name` once it is complete and on disk.
   subroutine write_part(name, part, case, text, inputs, run, store, error)
      character(len=*), intent(in) :: name, part
      type(case_t), intent(in) :: case
      character(len=*), intent(in) :: text  !! case text, with the command-line options applied
      type(inputs_t), intent(in) :: inputs
      type(run_t), intent(inout), target :: run
      type(spilled_crossings_t), intent(in) :: store  !! store with the earlier crossings
      type(error_t), allocatable, intent(out) :: error
      type(netcdf_file_t) :: file
      type(part_t), target :: packed
      logical :: done

      call settle_run(run, inputs%scene%release, 1)
      call pack_part(run, packed, error)
      if (.not. allocated(error)) call create_netcdf(part, file)
      if (.not. allocated(error) .and. is_ok(file)) then
         call describe(file, case, text, inputs, run)
         call pass_arrays(file, run, packed, store%n)
         call write_blocks(file, run, store)
      end if
      call settle_run(run, inputs%scene%release, -1)
      if (allocated(error)) then
         error%message = name//": cannot be written: "//error%message
         return
      end if
      call close_netcdf(file)
      done = is_ok(file)
      if (done) done = replace_file(part, name)
      if (done) return
      if (is_ok(file)) then
         call fail(error, name//": cannot be replaced (is it open in another program?). The new file is "//part)
      else
         done = remove_file(part)
         call fail(error, name//": cannot be written: "//trim(nf90_strerror(file%status)) &
                   //" (disk or memory may be full)")
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
         call record_status(file, nf90_put_att(file%id, nf90_global, "source", "rockfall "//version))
         call record_status(file, nf90_put_att(file%id, nf90_global, "version", version))
         call record_status(file, nf90_put_att(file%id, nf90_global, "case", text))
         call record_status(file, nf90_put_att(file%id, nf90_global, "case_file", inputs%case_file))
         call record_status(file, nf90_put_att(file%id, nf90_global, "impact_set", case%sets))
         call record_status(file, nf90_put_att(file%id, nf90_global, "impact_set_checksum", inputs%impact_set_checksum))
         call record_status(file, nf90_put_att(file%id, nf90_global, "input_checksums", inputs%input_checksums))
         call record_status(file, nf90_put_att(file%id, nf90_global, "decoded_checksums", inputs%decoded_checksums))
         if (inputs%input_warnings /= "") &
            call record_status(file, nf90_put_att(file%id, nf90_global, "input_warnings", inputs%input_warnings))
         if (inputs%lines_beyond /= "") &
            call record_status(file, nf90_put_att(file%id, nf90_global, "lines_beyond", inputs%lines_beyond))
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
         if (allocated(inputs%scene%shapes)) &
            call record_status(file, nf90_put_att(file%id, nf90_global, "block_shapes", joined(block_shapes, " ")))
         if (allocated(inputs%scene%grounds)) &
            call describe_grounds(file, inputs%scene%grounds(:n_grounds(inputs%scene)))
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

   !> Write names and models of the ground types, one line each, and the radii of the largest blocks of their tables.
   subroutine describe_grounds(file, grounds)
      type(netcdf_file_t), intent(inout) :: file
      type(ground_t), intent(in) :: grounds(:)
      character(len=:), allocatable :: names, models
      real(wp) :: radii(size(grounds))  !! radii [m]; NaN without a table, or if largest_block gives NaN
      integer :: k

      names = grounds(1)%name
      models = trim(model_names(grounds(1)%classical%model))
      do k = 2, size(grounds)
         names = names//new_line(names)//grounds(k)%name
         models = models//new_line(names)//trim(model_names(grounds(k)%classical%model))
      end do
      call record_status(file, nf90_put_att(file%id, nf90_global, "grounds", names))
      radii = ieee_value(1.0_wp, ieee_quiet_nan)
      do k = 1, size(grounds)
         if (allocated(grounds(k)%table)) radii(k) = largest_of(grounds(k)%table)
      end do
      call record_status(file, nf90_put_att(file%id, nf90_global, "ground_models", models))
      call record_status(file, nf90_put_att(file%id, nf90_global, "ground_block_radius", radii))
   end subroutine describe_grounds

   !> R_b of the largest blocks of an impact table [m].
   pure real(wp) function largest_of(table)
      type(impact_table_t), intent(in) :: table

      largest_of = largest_block(maxval(table%size), table%ground%strength, table%ground%strength_radius)
   end function largest_of

   !> First column and row, counted from 0, and numbers of columns and rows of the maps.
   pure function window_of(run) result(window)
      type(run_t), intent(in) :: run
      integer :: window(4)

      window = [run%maps%at - 1, run%maps%nodes]
   end function window_of

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

   !> Transfer all arrays of a part, and the rows of the completed boulders; `before` crossings are already in the file.
   subroutine pass_arrays(file, run, part, before)
      type(netcdf_file_t), intent(inout) :: file
      type(run_t), intent(in), target :: run
      type(part_t), intent(in), target :: part
      integer(i8), intent(in) :: before
      type(table_t) :: table
      integer :: k

      table = part_arrays(run, part)
      do k = 1, size(table%row)
         call pass_array(file, table%row(k), rows_of(run), before)
      end do
   end subroutine pass_arrays

   !> Write the crossings of a store, before the crossings of the run.
   subroutine write_blocks(file, run, store)
      type(netcdf_file_t), intent(inout) :: file
      type(run_t), intent(in) :: run
      type(spilled_crossings_t), intent(in) :: store
      type(crossing_rows_t), target :: rows
      type(table_t) :: table
      integer(i1), pointer, contiguous :: bytes(:)
      integer(i8) :: first
      integer :: block, k
      logical :: good

      if (store%n == 0) return
      first = 0
      do block = 1, size(store%size)
         call store%read_block(block, run%crossings, rows, good)
         if (.not. good) call mark_damaged(file, "the crossings of lines")
         if (.not. is_ok(file)) return
         table = table_t()
         call add_crossing_arrays(rows, table)
         do k = 1, size(table%row)
            associate (row => table%row(k))
               call c_f_pointer(row%at, bytes, [bytes_of(row)*row%length(1)])
               call write_rows(file, name_in_files(row%variable), first, row%length(1), bytes)
            end associate
         end do
         first = first + rows%n
      end do
   end subroutine write_blocks

   !> Transfer an array: the first `rows` rows of an array of boulders; crossings after the first `before`.
   subroutine pass_array(file, row, rows, before)
      type(netcdf_file_t), intent(inout) :: file
      type(array_t), intent(in) :: row
      integer(i8), intent(in) :: rows, before
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
      if (row%axis(1) == "boulder" .and. row%rank == 2) then  ! more rows are allocated than are used
         do k = 1, int(row%length(2))
            call transfer(file, definition, axes, bytes((k - 1)*step + 1:), k)
         end do
      else if (row%axis(1) == "crossing" .and. before > 0) then
         axes%length = axes%length + before
         call define(file, definition, axes)
         call write_rows(file, trim(definition%name), before, row%length(1), bytes)
      else
         call transfer(file, definition, axes, bytes)
      end if
      if (.not. file%writes .or. .not. is_ok(file)) return
      select case (row%variable%name)
      case ("status")
         call record_status(file, nf90_inq_varid(file%id, "status", id))
         call record_status(file, nf90_put_att(file%id, id, "flag_values", [(int(k, i1), k=1, size(statuses))]))
         call record_status(file, nf90_put_att(file%id, id, "flag_meanings", joined(statuses, " ")))
      case ("outcome")
         call record_status(file, nf90_inq_varid(file%id, definition%name, id))
         call record_status(file, nf90_put_att(file%id, id, "flag_values", [(int(k, i1), k=0, size(outcomes))]))
         call record_status(file, nf90_put_att(file%id, id, "flag_meanings", "not_met "//joined(outcomes, " ")))
      case ("block_shape")
         call record_status(file, nf90_inq_varid(file%id, "block_shape", id))
         call record_status(file, nf90_put_att(file%id, id, "flag_values", [(k, k=1, size(block_shapes))]))
         call record_status(file, nf90_put_att(file%id, id, "flag_meanings", joined(block_shapes, " ")))
      end select
   end subroutine pass_array

   !> Size of the rows of all boulders [bytes]; every file of the run is larger.
   integer(i8) function row_bytes(run)
      type(run_t), intent(inout), target :: run
      type(table_t) :: table
      integer :: k

      table = arrays_of(run)
      row_bytes = 0
      do k = 1, size(table%row)
         associate (row => table%row(k))
            if (row%axis(1) == "boulder" .and. row%variable%group /= "work") &
               row_bytes = row_bytes + bytes_of(row)*product(row%length)
         end associate
      end do
   end function row_bytes

   pure integer function bytes_of(row)
      type(array_t), intent(in) :: row

      bytes_of = merge(8, merge(4, 1, row%kind(2:) == "4"), row%kind(2:) == "8")
   end function bytes_of

   ! ---- read ---------------------------------------------------------------------------------

   !> Number of boulders in a file with this layout; -1 if the file has another format.
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

   !> Return whether a file is a part that contains all boulders of a run that has completed none.
   logical function is_finished(name, inputs, run)
      character(len=*), intent(in) :: name
      type(inputs_t), intent(in) :: inputs
      type(run_t), intent(inout) :: run
      type(netcdf_file_t) :: file
      type(error_t), allocatable :: error

      is_finished = .false.
      call open_netcdf(name, file, error)
      if (allocated(error)) return
      call check_run(file, inputs, run, error)
      is_finished = .not. allocated(error) .and. is_ok(file) .and. run%done == run%boulders
      run%done = 0
      run%wall = 0
      run%cpu = 0
      call close_netcdf(file)
   end function is_finished

   !> Read the part from which a run continues. Its boulders must be the first of the run; other and damaged parts are
   !> rejected.
   subroutine read_part(name, inputs, run, error)
      character(len=*), intent(in) :: name
      type(inputs_t), intent(in) :: inputs
      type(run_t), intent(inout), target :: run
      type(error_t), allocatable, intent(out) :: error
      type(netcdf_file_t) :: file
      type(part_t), target :: part
      logical :: good

      call open_netcdf(name, file, error)
      if (.not. allocated(error)) call check_run(file, inputs, run, error)
      if (allocated(error)) return
      if (is_ok(file)) then
         call make_room(run, part, lengths_of(file, run), error)
         if (.not. allocated(error)) call pass_arrays(file, run, part, 0_i8)
         if (.not. allocated(error) .and. is_ok(file)) call unpack_part(run, part, inputs%arrays%grid, error)
         if (allocated(error)) error%message = name//": "//error%message
      end if
      if (.not. allocated(error) .and. is_ok(file) .and. allocated(run%maps%shared%cell)) then
         call restore_run(run, inputs%scene%release, good)
         if (.not. good) call mark_damaged(file, "tally_shared_cell")
      end if
      if (.not. is_ok(file)) call fail_damaged(file, error)
      if (allocated(error)) error%message = error%message//": remove it to start again"
      call close_netcdf(file)
   end subroutine read_part

   !> Lengths of the arrays of a part.
   type(part_lengths_t) function lengths_of(file, run) result(length)
      type(netcdf_file_t), intent(in) :: file
      type(run_t), intent(in) :: run

      length%rows = rows_of(run)
      length%cells = length_of(file, "tally")
      length%shared = length_of(file, "tally_shared")
      length%blocks = length_of(file, "sample_entry")
      length%group_bins = length_of(file, "sample_group_entry")
      length%crossings = length_of(file, "crossing")
   end function lengths_of

   !> Check that the file belongs to this run, and that its boulders are the first of the run.
   subroutine check_run(file, inputs, run, error)
      type(netcdf_file_t), intent(inout) :: file
      type(inputs_t), intent(in) :: inputs
      type(run_t), intent(inout) :: run
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: what
      type(identity_t) :: ours, theirs

      ours%version = version
      ours%keys = inputs%keys
      ours%read = inputs%input_checksums
      ours%decoded = inputs%decoded_checksums
      ours%total = run%total
      ours%first = run%before + 1
      ours%last = run%before + run%boulders
      ours%grid = inputs%arrays%grid
      ours%window = window_of(run)
      theirs%version = text_of(file, nf90_global, "version")
      theirs%keys = keys_of(text_of(file, nf90_global, "case"))
      theirs%read = text_of(file, nf90_global, "input_checksums")
      theirs%decoded = text_of(file, nf90_global, "decoded_checksums")
      theirs%total = integer_of(file, "boulders_requested")
      theirs%first = integer_of(file, "boulder_first")
      theirs%last = integer_of(file, "boulder_last")
      theirs%grid = ours%grid
      theirs%window = int(integers_of(file, "map_window", 4))
      what = "layout"
      if (integer_of(file, "part_layout") == layout) what = difference(ours, theirs)
      if (what /= "") then
         call fail(error, file%name//": belongs to a different run ("//what//" differs): remove it, or choose " &
                   //"another output")
         return
      end if
      run%done = theirs%last - theirs%first + 1
      run%wall = real_of(file, "wall_seconds")
      run%cpu = real_of(file, "cpu_seconds")
      if (.not. (ieee_is_finite(run%wall) .and. ieee_is_finite(run%cpu))) then
         call mark_damaged(file, "wall_seconds")
      else if (min(run%wall, run%cpu) < 0) then
         call mark_damaged(file, "wall_seconds")
      end if
   end subroutine check_run
end module rockfall_part_file
