! SPDX-License-Identifier: BSD-3-Clause
!> The part file (docs/files.md): results of some boulders of a run, with tallies that add up to those of all. A
!> checkpoint, a shard's result and this program's result are one; `rockfall` reads and writes the same.
module rockfall_part_file
   use, intrinsic :: iso_c_binding, only: c_f_pointer, c_loc
   use, intrinsic :: ieee_arithmetic, only: ieee_is_nan, ieee_is_finite
   use netcdf, only: nf90_global, nf90_copy_att, nf90_inq_attname, nf90_inq_varid, nf90_inquire_variable, &
                     nf90_put_att, nf90_strerror, nf90_byte, nf90_int, nf90_int64, nf90_float, nf90_double
   use rockfall_kinds, only: wp, i1, i4, i8
   use rockfall_error, only: error_t, fail
   use rockfall_text, only: joined
   use rockfall_version, only: version
   use rockfall_grid, only: grid_t
   use rockfall_filesystem, only: replace_file, remove_file
   use rockfall_netcdf_file, only: netcdf_file_t, axis_t, about_t, open_netcdf, create_netcdf, close_netcdf, keep, &
                                   sound, mark_damaged, fail_damaged, pass, length_of, text_of, integers_of, real_of
   use rockfall_variables, only: variable_t, variable_table, stored_as, layout => part_layout, boulder_fields, &
                                 boulder_counts, energy_fields, line_fields, vertex_fields, histogram_fields, &
                                 statuses
   use rockfall_histogram, only: n_bins
   use rockfall_maps, only: maps_t
   use rockfall_source_maps, only: contributing_t, contributing_cells, partial_sources, settle
   use rockfall_boulder, only: first_of, last_of
   use rockfall_barrier, only: passed_over
   use rockfall_ground, only: ground_t
   use rockfall_grounds, only: model_names
   use rockfall_case, only: case_t
   use rockfall_case_file, only: differing_key
   use rockfall_scene_file, only: inputs_t
   use rockfall_line_samples, only: layout_t
   use rockfall_run_loop, only: results_t, map_tallies
   implicit none
   private
   public :: write_part, read_part, boulders_in, is_result

   character(len=*), parameter :: types(*) = ["i1", "i4", "i8", "f4", "f8"]  !! as `stored_as` has them
   integer, parameter :: kinds(*) = [nf90_byte, nf90_int, nf90_int64, nf90_float, nf90_double]

   !> The tallies of cells, gathered: where they were reached, and what partial sources contribute.
   type :: tally_t
      integer(i8), allocatable :: cell(:)  !! counted from 0
      type(contributing_t) :: shared
   end type tally_t

contains

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

      maps = map_tallies(results, [1, 1])
      tally%shared = contributing_cells(maps, inputs%scene%release, results%before + 1, results%before + results%done)
      tally%cell = reached_cells(results)
      call create_netcdf(part, file)
      if (sound(file)) then
         call describe(file, case, text, inputs, results)
         call pass_rows(file, case, results)
         if (allocated(results%number)) call write_samples(file, results)
         call settle(maps, inputs%scene%release, tally%shared, 1)
         call pass_tallies(file, results, tally)
         call settle(maps, inputs%scene%release, tally%shared, -1)
         call write_trajectories(file, results)
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

   !> What the part is of; the grid mapping of its terrain is that of the scene file.
   subroutine describe(file, case, text, inputs, results)
      type(netcdf_file_t), intent(inout) :: file
      type(case_t), intent(in) :: case
      character(len=*), intent(in) :: text
      type(inputs_t), intent(in) :: inputs
      type(results_t), intent(in) :: results
      character(len=128) :: name
      integer(i8) :: whole
      integer :: crs(1), id, k, n

      crs = 0
      call pass(file, about_t("crs", nf90_int, "1", "coordinate reference system"), [axis_t ::], crs)
      n = 0
      call keep(file, nf90_inq_varid(file%id, "crs", id))
      call keep(file, nf90_inquire_variable(inputs%file%id, inputs%crs, natts=n))
      do k = 1, n
         call keep(file, nf90_inq_attname(inputs%file%id, inputs%crs, k, name))
         if (name /= "_FillValue") call keep(file, nf90_copy_att(inputs%file%id, inputs%crs, trim(name), file%id, id))
      end do
      whole = merge(1, 0, results%done == results%asked)
      associate (grid => inputs%arrays%grid, last => results%before + results%done)
         call keep(file, nf90_put_att(file%id, nf90_global, "Conventions", "CF-1.11"))
         call keep(file, nf90_put_att(file%id, nf90_global, "part_layout", layout))
         call keep(file, nf90_put_att(file%id, nf90_global, "title", case%title))
         call keep(file, nf90_put_att(file%id, nf90_global, "source", "rockfall "//version &
                                      //", stochastic impact model of Bourrier et al. (2009)"))
         call keep(file, nf90_put_att(file%id, nf90_global, "version", version))
         call keep(file, nf90_put_att(file%id, nf90_global, "case", text))
         call keep(file, nf90_put_att(file%id, nf90_global, "case_file", inputs%case_file))
         call keep(file, nf90_put_att(file%id, nf90_global, "impact_set", case%sets))
         call keep(file, nf90_put_att(file%id, nf90_global, "impact_set_checksum", inputs%impact_set_checksum))
         call keep(file, nf90_put_att(file%id, nf90_global, "input_checksums", inputs%input_checksums))
         call keep(file, nf90_put_att(file%id, nf90_global, "decoded_checksums", inputs%decoded_checksums))
         if (inputs%input_warnings /= "") &
            call keep(file, nf90_put_att(file%id, nf90_global, "input_warnings", inputs%input_warnings))
         if (inputs%dams /= "") call keep(file, nf90_put_att(file%id, nf90_global, "dams", inputs%dams))
         call keep(file, nf90_put_att(file%id, nf90_global, "seed", case%seed))
         call keep(file, nf90_put_att(file%id, nf90_global, "boulder_first", results%before + 1))
         call keep(file, nf90_put_att(file%id, nf90_global, "boulder_last", last))
         call keep(file, nf90_put_att(file%id, nf90_global, "boulders_requested", results%asked))
         call keep(file, nf90_put_att(file%id, nf90_global, "complete", whole))
         call keep(file, nf90_put_att(file%id, nf90_global, "threads", int(results%threads, i8)))
         call keep(file, nf90_put_att(file%id, nf90_global, "date_created", local_time()))
         call keep(file, nf90_put_att(file%id, nf90_global, "wall_seconds", results%wall))
         call keep(file, nf90_put_att(file%id, nf90_global, "cpu_seconds", results%cpu))
         call keep(file, nf90_put_att(file%id, nf90_global, "terrain_cells", [grid%nx, grid%ny]))
         call keep(file, nf90_put_att(file%id, nf90_global, "map_window", window_of(results)))
         if (inputs%feature_names /= "") &
            call keep(file, nf90_put_att(file%id, nf90_global, "source_features", inputs%feature_names))
         if (allocated(inputs%scene%grounds)) call describe_grounds(file, inputs%scene%grounds)
      end associate
   end subroutine describe

   !> Date and time with their zone (ISO 8601).
   function local_time() result(text)
      character(len=25) :: text
      character(len=8) :: date
      character(len=10) :: time
      character(len=5) :: zone

      call date_and_time(date, time, zone)
      text = date(1:4)//"-"//date(5:6)//"-"//date(7:8)//"T"//time(1:2)//":"//time(3:4)//":"//time(5:6) &
             //zone(1:3)//":"//zone(4:5)
   end function local_time

   !> Names and models of the grounds, a line each.
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
      call keep(file, nf90_put_att(file%id, nf90_global, "grounds", names))
      call keep(file, nf90_put_att(file%id, nf90_global, "ground_models", models))
   end subroutine describe_grounds

   !> First column and row, from 0, and number of columns and rows of the maps.
   pure function window_of(results) result(window)
      type(results_t), intent(in) :: results
      integer :: window(4)

      window = [results%at - 1, results%grid%nx, results%grid%ny]
   end function window_of

   !> Cells of the maps.
   pure integer(i8) function cells_of(results)
      type(results_t), intent(in) :: results

      cells_of = size(results%counts, 1, i8)*size(results%counts, 2, i8)
   end function cells_of

   subroutine write_trajectories(file, results)
      type(netcdf_file_t), intent(inout) :: file
      type(results_t), intent(inout) :: results
      type(axis_t) :: vertex(1)
      integer :: k

      if (.not. allocated(results%vertex)) return
      if (size(results%vertex) == 0) return
      vertex = [axis_t("trajectory_vertex", size(results%vertex, 1, i8))]
      call pass(file, described("vertex", "boulder"), vertex, results%vertex_boulder)
      do k = 1, size(vertex_fields)
         call pass(file, described("vertex", vertex_fields(k)), vertex, results%vertex(:, k))
      end do
   end subroutine write_trajectories

   !> Cells in which any tally is not zero, counted from 0 by rows.
   pure function reached_cells(results) result(cells)
      type(results_t), intent(in) :: results
      integer(i8), allocatable :: cells(:)
      logical, allocatable :: reached(:, :)
      integer(i8) :: k

      reached = any(results%counts /= 0, dim=3) .or. any(results%sums /= 0, dim=3) .or. any(results%maxima > 0, dim=3)
      if (size(results%column) > 0) reached = reached .or. results%column > 0
      cells = pack([(k, k=0, size(reached, kind=i8) - 1)], reshape(reached, [size(reached)]))
   end function reached_cells

   ! ---- to disk, and from it -----------------------------------------------------------------

   !> A variable as its row of the table describes it.
   pure type(about_t) function described(group, name) result(about)
      character(len=*), intent(in) :: group, name
      type(variable_t) :: row
      integer :: k

      do k = 1, size(variable_table)
         row = variable_table(k)
         if (row%group == group .and. row%name == name) exit
      end do
      about = about_t(name, kinds(findloc(types, stored_as(row), dim=1)), row%units, row%long_name, row%comment)
      select case (group)
      case ("line", "barrier", "tally", "sample"); about%name = trim(group)//"_"//name
      case ("vertex"); about%name = "trajectory_"//name
      case ("histogram")
         about%name = trim(name)//"_histogram"
         about%units = "1"
         about%long_name = "rebounds by "//row%long_name
      end select
   end function described

   !> Rows of the boulders done, and counts over all of them.
   subroutine pass_rows(file, case, results)
      type(netcdf_file_t), intent(inout) :: file
      type(case_t), intent(in) :: case
      type(results_t), intent(inout) :: results
      type(axis_t) :: boulder, line
      integer :: id, k, l, n

      n = int(results%rows)
      boulder = axis_t("boulder", results%rows)
      if (allocated(results%number)) call pass(file, described("kept", "boulder"), [boulder], results%number(:n))
      do k = 1, size(boulder_fields)
         call pass(file, described("boulder", boulder_fields(k)), [boulder], results%boulder(:n, k))
      end do
      call pass(file, described("boulder", "status"), [boulder], results%status(:n))
      if (nf90_inq_varid(file%id, "status", id) == 0 .and. file%writes) then
         call keep(file, nf90_put_att(file%id, id, "flag_values", [(int(k, i1), k=1, size(statuses))]))
         call keep(file, nf90_put_att(file%id, id, "flag_meanings", joined(statuses, " ")))
      end if
      call pass(file, described("boulder", "impacts"), [boulder], results%impacts(:n))
      call pass(file, described("boulder", "source"), [boulder], results%source(:n))
      if (size(results%feature) > 0) &
         call pass(file, described("feature", "source_feature"), [boulder], results%feature(:n))
      if (case%energy_balance) then
         do k = 1, size(energy_fields)
            call pass(file, described("energy", energy_fields(k)), [boulder], results%energy(:n, k))
         end do
      end if
      if (case%forest) call pass(file, described("tree", "trees_hit"), [boulder], results%trees_hit(:n))
      do k = 4, size(boulder_counts)
         call pass(file, described("count", boulder_counts(k)), [axis_t ::], results%count(k:k))
      end do
      if (size(results%by_ground) > 0) &
         call pass(file, described("ground", "rebounds_by_ground"), [axis_t("ground", size(results%by_ground, &
            kind=i8))], &
                   results%by_ground)
      line = axis_t("line", size(case%lines, kind=i8))
      do k = 1, size(line_fields)
         do l = 1, size(case%lines)
            call pass(file, described("line", line_fields(k)), [boulder, line], results%line(:n, l, k), l)
         end do
      end do
      line = axis_t("barrier", size(results%outcome, 2, i8))
      do l = 1, size(results%outcome, 2)
         call pass(file, described("barrier", "outcome"), [boulder, line], results%outcome(:n, l), l)
      end do
      if (.not. case%rebounds) return
      do k = 1, size(histogram_fields)
         call pass(file, described("histogram", histogram_fields(k)), &
                   [axis_t(trim(histogram_fields(k))//"_bin", int(n_bins(k), i8))], results%histogram(:n_bins(k), k))
      end do
   end subroutine pass_rows

   pure integer(i8) function last_done(results)
      type(results_t), intent(in) :: results

      last_done = results%before + results%done
   end function last_done

   !> Samples: of bins those that are not empty.
   subroutine write_samples(file, results)
      type(netcdf_file_t), intent(inout) :: file
      type(results_t), intent(inout), target :: results
      integer(i4), pointer, contiguous :: flat(:)
      integer(i8), allocatable :: bin(:)
      integer(i4), allocatable :: count(:)

      flat(1:size(results%samples%bins, kind=i8)) => results%samples%bins
      call gather(flat, bin, count)
      call pass_bins(file, "", bin, count)
      flat(1:size(results%samples%groups, kind=i8)) => results%samples%groups
      call gather(flat, bin, count)
      call pass_bins(file, "group_", bin, count)
      call pass_sums(file, results)
   end subroutine write_samples

   !> Read what was written, and check it.
   subroutine read_samples(file, results)
      type(netcdf_file_t), intent(inout) :: file
      type(results_t), intent(inout), target :: results
      integer(i4), pointer, contiguous :: flat(:)
      type(layout_t) :: layout

      flat(1:size(results%samples%bins, kind=i8)) => results%samples%bins
      call scatter(file, "", flat)
      flat(1:size(results%samples%groups, kind=i8)) => results%samples%groups
      call scatter(file, "group_", flat)
      layout = results%layout
      call pass_sums(file, results)
      if (.not. sound(file)) return
      if (any(layout%part_last /= results%layout%part_last)) call mark_damaged(file, "sample_part_last")
      if (any(layout%group_part /= results%layout%group_part)) call mark_damaged(file, "sample_group_part")
      associate (sums => results%samples%sums, ended => results%samples%ended)
         if (any(sums(2:, :, :, :) < 0) .or. any(shiftr(sums(2:4:2, :, :, :), 62) /= 0)) &
            call mark_damaged(file, "sample_sums")
         if (any(ended < 0) .or. sum(ended) /= results%done) call mark_damaged(file, "sample_ended")
      end associate
      if (.not. are_heaps(results%samples%largest)) call mark_damaged(file, "sample_largest")
   end subroutine read_samples

   !> Bins that are not empty, counted from 0, and what is in them.
   pure subroutine gather(flat, bin, counts)
      integer(i4), intent(in) :: flat(:)
      integer(i8), allocatable, intent(out) :: bin(:)
      integer(i4), allocatable, intent(out) :: counts(:)
      integer(i8) :: k, n

      n = count(flat /= 0, kind=i8)
      allocate (bin(n), counts(n))
      n = 0
      do k = 1, size(flat, kind=i8)
         if (flat(k) == 0) cycle
         n = n + 1
         bin(n) = k - 1
         counts(n) = flat(k)
      end do
   end subroutine gather

   !> Put the bins of a file to their places.
   subroutine scatter(file, before, flat)
      type(netcdf_file_t), intent(inout) :: file
      character(len=*), intent(in) :: before
      integer(i4), intent(inout) :: flat(:)
      integer(i8), allocatable :: bin(:)
      integer(i4), allocatable :: counts(:)
      integer :: n, status

      n = length_of(file, "sample_"//before//"entry")
      status = merge(1, 0, n < 0 .or. n > size(flat, kind=i8))
      if (status == 0) allocate (bin(n), counts(n), stat=status)
      if (status /= 0) call mark_damaged(file, "sample_"//before//"bin")
      if (.not. sound(file)) return
      call pass_bins(file, before, bin, counts)
      if (any(bin < 0 .or. bin >= size(flat, kind=i8)) .or. any(counts < 1) .or. any(bin(2:) <= bin(:n - 1))) &
         call mark_damaged(file, "sample_"//before//"bin")
      if (sound(file)) flat(bin + 1) = counts
   end subroutine scatter

   subroutine pass_bins(file, before, bin, counts)
      type(netcdf_file_t), intent(inout) :: file
      character(len=*), intent(in) :: before
      integer(i8), intent(inout) :: bin(:)
      integer(i4), intent(inout) :: counts(:)
      type(axis_t) :: entry

      entry = axis_t("sample_"//before//"entry", size(bin, kind=i8))
      call pass(file, described("sample", before//"bin"), [entry], bin)
      call pass(file, described("sample", before//"count"), [entry], counts)
   end subroutine pass_bins

   !> Sums, tails and layout.
   subroutine pass_sums(file, results)
      type(netcdf_file_t), intent(inout) :: file
      type(results_t), intent(inout), target :: results
      type(axis_t) :: place, part, group, quantity

      associate (samples => results%samples, layout => results%layout)
         place = axis_t("sample_place", size(samples%sums, 4, i8))
         part = axis_t("sample_part", size(layout%part_last, kind=i8))
         group = axis_t("sample_group", size(layout%group_part, kind=i8))
         quantity = axis_t("sample_quantity", size(samples%sums, 2, i8))
         call pass(file, described("sample", "sums"), [axis_t("sample_word", size(samples%sums, 1, i8)), quantity, &
                                                       part, place], samples%sums)
         call pass(file, described("sample", "largest"), [axis_t("sample_rank", size(samples%largest, 1, i8)), &
                                                          axis_t("sample_tail", size(samples%largest, 2, i8)), &
                                                          axis_t("sample_line", size(samples%largest, 3, i8))], &
                   samples%largest)
         call pass(file, described("sample", "ended"), [axis_t("sample_status", size(samples%ended, kind=i8))], &
                   samples%ended)
         call pass(file, described("sample", "part_last"), [part], layout%part_last)
         call pass(file, described("sample", "group_part"), [group], layout%group_part)
      end associate
   end subroutine pass_sums

   !> Whether each column is a heap of numbers, -1 for none; sorted ones are.
   pure logical function are_heaps(largest)
      real(wp), intent(in) :: largest(:, :, :)
      integer :: k

      are_heaps = all(ieee_is_finite(largest)) .and. all(largest >= 0 .or. largest <= -1)
      do k = 2, size(largest, 1)
         are_heaps = are_heaps .and. all(largest(k, :, :) >= largest(k/2, :, :))
      end do
   end function are_heaps

   !> The tallies of the cells that boulders reached.
   subroutine pass_tallies(file, results, tally)
      type(netcdf_file_t), intent(inout) :: file
      type(results_t), intent(inout), target :: results
      type(tally_t), intent(inout) :: tally
      type(axis_t) :: cells, shared

      cells = axis_t("tally", size(tally%cell, kind=i8))
      call pass(file, described("tally", "cell"), [cells], tally%cell)
      if (.not. sound(file) .or. .not. in_order(file, tally%cell, results)) return
      call pass_stack("counts", results%counts, 1, size(results%counts, 3))
      call pass_stack("sums", results%sums, 2, size(results%sums, 3))
      call pass_stack("maxima", results%maxima, 1, size(results%maxima, 3))
      if (size(results%column) > 0) call pass_classes(file, results, tally%cell, cells)
      if (size(results%stamp) == 0) return
      shared = axis_t("tally_shared", size(tally%shared%cell, kind=i8))
      call pass(file, described("tally", "shared_cell"), [shared], tally%shared%cell)
      call pass(file, described("tally", "shared_source"), [shared], tally%shared%source)
      call pass(file, described("tally", "shared_boulders"), [shared], tally%shared%boulders)

   contains

      !> A stack of layers: the values of the cells of each, as words of 32 bits.
      subroutine pass_stack(name, stack, words, layers)
         character(len=*), intent(in) :: name
         integer, intent(in) :: words, layers
         type(*), intent(inout), target :: stack(*)  !! (nx, ny, layers)
         integer(i4), pointer :: value(:, :, :)
         integer(i4), allocatable :: some(:, :)
         type(axis_t) :: layer
         integer :: k

         if (layers == 0) return
         call c_f_pointer(c_loc(stack), value, [int(words, i8), cells_of(results), int(layers, i8)])
         layer = axis_t("tally_"//name//"_layer", int(layers, i8))
         do k = 1, layers
            some = value(:, tally%cell + 1, k)
            call pass(file, described("tally", name), [cells, layer], some, k)
            value(:, tally%cell + 1, k) = some
         end do
      end subroutine pass_stack
   end subroutine pass_tallies

   !> Counts of classes, of all cells together.
   subroutine pass_classes(file, results, cell, cells)
      type(netcdf_file_t), intent(inout) :: file
      type(results_t), intent(inout), target :: results
      integer(i8), intent(in) :: cell(:)
      type(axis_t), intent(in) :: cells
      integer(i4), pointer :: column(:)
      integer(i4), allocatable :: counts(:, :)
      integer :: k, status

      column(1:size(results%column)) => results%column
      allocate (counts(results%plan%rows, size(cell)), source=0_i4, stat=status)
      if (status /= 0 .or. size(cell) > size(results%bin_counts, 2)) then
         call mark_damaged(file, "(no memory) tally_bin_counts")
         return
      end if
      do k = 1, size(cell)
         if (column(cell(k) + 1) > 0) counts(:, k) = results%bin_counts(:, column(cell(k) + 1))
      end do
      call pass(file, described("tally", "bin_counts"), &
                [axis_t("tally_bin", int(results%plan%rows, i8)), cells], counts)
      if (file%writes .or. .not. sound(file)) return
      results%bin_counts(:, :size(cell)) = counts
      column(cell + 1) = [(int(k, i4), k=1, size(cell))]
      results%columns = size(cell)
   end subroutine pass_classes

   ! ---- from disk ----------------------------------------------------------------------------

   !> How many boulders a file of this layout holds; -1 if it is no such file.
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

   !> Whether a file is a part or a result of a run that rockfall wrote.
   logical function is_result(name)
      character(len=*), intent(in) :: name
      type(netcdf_file_t) :: file
      type(error_t), allocatable :: error

      call open_netcdf(name, file, error)
      is_result = .not. allocated(error)
      if (.not. is_result) return
      is_result = index(text_of(file, nf90_global, "source"), "rockfall ") == 1
      if (is_result) is_result = integer_of(file, "boulders_requested") >= 0
      call close_netcdf(file)
   end function is_result

   integer(i8) function integer_of(file, name) result(value)
      type(netcdf_file_t), intent(in) :: file
      character(len=*), intent(in) :: name

      value = sum(integers_of(file, name, 1))
   end function integer_of

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
      type(tally_t) :: tally
      integer(i8), allocatable :: number(:)

      call open_netcdf(name, file, error)
      if (.not. allocated(error)) call check_run(file, text, inputs, results, error)
      if (allocated(error)) return
      results%rows = results%done
      if (allocated(results%number)) results%rows = count(results%number <= last_done(results), kind=i8)
      if (allocated(results%number)) number = results%number
      call pass_rows(file, case, results)
      if (allocated(number)) then
         if (any(number /= results%number)) call mark_damaged(file, "boulder")
      end if
      if (sound(file) .and. allocated(number)) call read_samples(file, results)
      if (sound(file)) call check_rows(file, inputs%arrays%grid, results)
      call make_room(file, results, tally)
      if (sound(file)) call pass_tallies(file, results, tally)
      if (sound(file)) call check_tallies(file, results)
      if (sound(file) .and. size(results%stamp) > 0) call restore_sources(file, inputs, results, tally%shared)
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
      integer(i8) :: first, last, asked

      first = integer_of(file, "boulder_first")
      last = integer_of(file, "boulder_last")
      asked = integer_of(file, "boulders_requested")
      key = differing_key(text_of(file, nf90_global, "case"), text, of_arrays=.false.)
      what = ""
      if (any(integers_of(file, "map_window", 4) /= window_of(results))) what = "window"
      if (text_of(file, nf90_global, "decoded_checksums") /= inputs%decoded_checksums) what = "decoded_checksums"
      if (text_of(file, nf90_global, "input_checksums") /= inputs%input_checksums) what = "input_checksums"
      if (first /= results%before + 1 .or. last > results%before + results%boulders .or. last < first &
          .or. asked /= results%asked) what = "boulders"
      if (key /= "") what = key
      if (text_of(file, nf90_global, "version") /= version) what = "version"
      if (integer_of(file, "part_layout") /= layout) what = "layout"
      if (what /= "") then
         call fail(error, file%name//": is of another run, its "//what//" differs; remove it, or run without " &
                   //"--resume elsewhere")
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

   !> Rows are numbers; at lines only where there is a time.
   subroutine check_rows(file, grid, results)
      type(netcdf_file_t), intent(inout) :: file
      type(grid_t), intent(in) :: grid
      type(results_t), intent(in) :: results
      integer, parameter :: time = findloc(line_fields, "time", dim=1)
      integer :: k

      associate (n => results%rows)
         do k = 1, size(boulder_fields)
            if (.not. all(ieee_is_finite(results%boulder(:n, k)))) call mark_damaged(file, trim(boulder_fields(k)))
         end do
         call check_ranges(file, grid, results%boulder(:n, :))
         if (.not. all(ieee_is_finite(results%energy(:min(n, size(results%energy, 1, kind=i8)), :)))) &
            call mark_damaged(file, "energy_released, or another energy")
         if (any(results%status(:n) < 1 .or. results%status(:n) > size(statuses))) call mark_damaged(file, "status")
         if (any(results%trees_hit(:min(n, size(results%trees_hit, kind=i8))) < 0)) call mark_damaged(file, "trees_hit")
         if (any(results%outcome(:n, :) < 0 .or. results%outcome(:n, :) > passed_over)) &
            call mark_damaged(file, "barrier_outcome")
         if (any(results%impacts(:n) < 0)) call mark_damaged(file, "impacts")
         if (any(results%source(:n) < 1)) call mark_damaged(file, "source")
         if (any(results%feature(:min(n, size(results%feature, kind=i8))) < 1)) &
            call mark_damaged(file, "source_feature")
         if (any(results%count < 0)) call mark_damaged(file, "rebounds, or another count")
         if (any(results%histogram < 0)) call mark_damaged(file, "a histogram")
         if (any(results%by_ground < 0)) call mark_damaged(file, "rebounds_by_ground")
         do k = 1, size(line_fields)
            associate (values => results%line(:n, :, k), crossed => .not. ieee_is_nan(results%line(:n, :, time)))
               if (any(ieee_is_finite(values) .neqv. crossed) .or. any(ieee_is_nan(values) .eqv. crossed)) &
                  call mark_damaged(file, "line_"//trim(line_fields(k)))
            end associate
         end do
      end associate
   end subroutine check_rows

   !> Boulders have volumes, and lie on the terrain (as out_of_range of python/rockfall/result/validate.py has it).
   subroutine check_ranges(file, grid, boulder)
      type(netcdf_file_t), intent(inout) :: file
      type(grid_t), intent(in) :: grid
      real(wp), intent(in) :: boulder(:, :)
      integer :: k
      logical :: wrong

      do k = 1, size(boulder_fields)
         associate (values => boulder(:, k))
            select case (boulder_fields(k))
            case ("volume")
               wrong = any(values <= 0)
            case ("start_x", "stop_x")
               wrong = any(values < grid%west .or. values > grid%west + grid%nx*grid%cell)
            case ("start_y", "stop_y")
               wrong = any(values < grid%north - grid%ny*grid%cell .or. values > grid%north)
            case ("start_z", "stop_z")
               wrong = .false.
            case default  ! lengths, times, speeds
               wrong = any(values < 0)
            end select
         end associate
         if (wrong) call mark_damaged(file, trim(boulder_fields(k)))
      end do
   end subroutine check_ranges

   !> Places for what is to be read of cells.
   subroutine make_room(file, results, tally)
      type(netcdf_file_t), intent(inout) :: file
      type(results_t), intent(in) :: results
      type(tally_t), intent(out) :: tally
      integer(i8) :: cells
      integer :: n, shared, status

      cells = cells_of(results)
      n = length_of(file, "tally")
      shared = merge(length_of(file, "tally_shared"), 0, size(results%stamp) > 0)
      if (n < 0 .or. n > cells) call mark_damaged(file, "tally_cell")
      if (shared < 0 .or. shared > 2*cells) call mark_damaged(file, "tally_shared_cell")
      if (.not. sound(file)) return
      allocate (tally%cell(n), tally%shared%cell(shared), tally%shared%source(shared), &
                tally%shared%boulders(shared), stat=status)
      if (status /= 0) call mark_damaged(file, "(no memory) tally_cell")
   end subroutine make_room

   !> Whether cells are cells of the maps, in their order.
   logical function in_order(file, cell, results)
      type(netcdf_file_t), intent(inout) :: file
      integer(i8), intent(in) :: cell(:)
      type(results_t), intent(in) :: results

      in_order = all(cell >= 0 .and. cell < cells_of(results))
      in_order = in_order .and. all(cell(2:) > cell(:size(cell) - 1))
      if (.not. in_order) call mark_damaged(file, "tally_cell")
   end function in_order

   subroutine check_tallies(file, results)
      type(netcdf_file_t), intent(inout) :: file
      type(results_t), intent(in) :: results

      if (any(results%counts < 0)) call mark_damaged(file, "tally_counts")
      if (any(results%sums < 0)) call mark_damaged(file, "tally_sums")
      if (.not. all(ieee_is_finite(results%maxima))) call mark_damaged(file, "tally_maxima")
      if (any(results%bin_counts(:, :results%columns) < 0)) call mark_damaged(file, "tally_bin_counts")
   end subroutine check_tallies

   !> The marks of partial sources, which go on to be counted. They must be sources that the boulders done cut, with as
   !> many boulders as they have among them, each with its cells in order.
   subroutine restore_sources(file, inputs, results, shared)
      type(netcdf_file_t), intent(inout) :: file
      type(inputs_t), intent(in) :: inputs
      type(results_t), intent(inout), target :: results
      type(contributing_t), intent(in) :: shared
      type(maps_t) :: maps
      integer(i8) :: first, last, own
      integer(i8), allocatable :: sources(:)
      integer :: k, n, left
      logical :: good

      first = results%before + 1
      last = results%before + results%done
      sources = partial_sources(inputs%scene%release, first, last)
      n = size(shared%cell)
      good = all(shared%cell >= 0 .and. shared%cell < cells_of(results))
      good = good .and. all(shared%source(2:) > shared%source(:n - 1) &
                            .or. (shared%source(2:) == shared%source(:n - 1) &
                                  .and. shared%cell(2:) > shared%cell(:n - 1)))
      left = n
      do k = 1, size(sources)
         associate (release => inputs%scene%release, source => sources(k))
            own = min(last, last_of(release, source)) - max(first, first_of(release, source)) + 1
         end associate
         left = left - count(shared%source == sources(k) .and. shared%boulders == own)
      end do
      if (.not. good .or. left /= 0) call mark_damaged(file, "tally_shared_cell")
      if (.not. sound(file)) return
      maps = map_tallies(results, [1, 1])
      call settle(maps, inputs%scene%release, shared, -1)
      do k = 1, n
         associate (layer => merge(2, 1, shared%source(k) == results%head), nx => size(results%stamp, 1, i8))
            results%stamp(mod(shared%cell(k), nx) + 1, shared%cell(k)/nx + 1, layer) = shared%source(k)
         end associate
      end do
   end subroutine restore_sources
end module rockfall_part_file
