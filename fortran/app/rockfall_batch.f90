! SPDX-License-Identifier: BSD-3-Clause
!> Warnings on standard error.
module warnings
   use, intrinsic :: iso_fortran_env, only: error_unit
   implicit none
   private
   public :: warn

contains

   subroutine warn(message)
      character(len=*), intent(in) :: message

      write (error_unit, "(2a)") "rockfall-batch: warning: ", message
      flush (error_unit)
   end subroutine warn
end module warnings

!> Standalone program: run a case on a scene file and write a part file. Only this file prints or stops the program.
program rockfall_batch
   use, intrinsic :: iso_fortran_env, only: error_unit, output_unit
   use rockfall_kinds, only: wp, i8
   use rockfall_error, only: error_t, fail, fault_mark
   use rockfall_text, only: integer_text
   use rockfall_version, only: version
   use rockfall_case, only: case_t, case_line_t
   use rockfall_grid, only: grid_t, is_outside
   use rockfall_namelist, only: namelist_t
   use rockfall_case_file, only: read_case_file
   use rockfall_system, only: start_process, end_at_once, is_folder, is_regular, path_exists, same_file, folder_of, &
                              hidden_name, &
                              temporary_name, take_lock, give_lock_back, check_place
   use rockfall_threads, only: check_team
   use rockfall_console, only: arguments_t, read_arguments, stem, one_line, decimal
   use rockfall_ground, only: ground_t
   use rockfall_scene_type, only: n_grounds
   use rockfall_scene_file, only: inputs_t, read_scene
   use rockfall_part_file, only: write_part
   use rockfall_crossing_rows, only: crossing_rows_t
   use rockfall_spilled_crossings, only: spilled_crossings_t
   use rockfall_checkpoint, only: checkpoint_t, check_checkpoint, name_checkpoint, remove_checkpoint
   use rockfall_run_state, only: run_t
   use rockfall_run_loop, only: run_case
   use rockfall_samples, only: sample_size, sample_sum
   use rockfall_line_samples, only: line_quantity, units_of
   use rockfall_variables, only: statuses, crossing_fields, row_integers
   use warnings, only: warn
   implicit none

   integer :: code

   call main(code)
   flush (output_unit)
   flush (error_unit)
   call end_at_once(code)  ! HDF5 would retry the failed writes and crash

contains

   !> Main procedure; all variables are local, so that they are finalised before the program stops.
   subroutine main(code)
      integer, intent(out) :: code
      type(arguments_t) :: arguments
      type(error_t), allocatable :: error

      call start_process()
      call read_arguments(arguments, error)
      code = 0
      if (arguments%help) then
         call print_help()
      else if (arguments%version) then
         write (output_unit, "(2a)") "rockfall-batch ", version
      else if (.not. allocated(error)) then
         call check_team(1, error)  ! before the stack is needed
         if (.not. allocated(error)) call run(arguments, error)
      end if
      if (.not. allocated(error)) return
      code = error%code
      call print_faults(error%message)
   end subroutine main

   !> Print each fault of an error in one line.
   subroutine print_faults(message)
      character(len=*), intent(in) :: message
      integer :: first, length

      first = 1
      do while (first <= len(message))
         length = index(message(first:)//fault_mark, fault_mark) - 1
         write (error_unit, "(2a)") "rockfall-batch: ", one_line(message(first:first + length - 1))
         first = first + length + 1
      end do
   end subroutine print_faults

   !> Run a case, after checking that its result can be written.
   subroutine run(arguments, error)
      type(arguments_t), intent(in) :: arguments
      type(error_t), allocatable, intent(out) :: error
      type(case_t), target :: case
      type(namelist_t) :: keys
      character(len=:), allocatable :: output, scene, text

      output = arguments%output
      if (output == "") output = stem(arguments%case)//".part"//integer_text(arguments%shard(1))//"of" &
                                 //integer_text(arguments%shard(2))
      scene = arguments%scene
      if (scene == "") scene = folder_of(arguments%case)//"scene.nc"
      call read_case_file(arguments%case, arguments%boulders, arguments%total, arguments%seed, arguments%threads, &
                          text, keys, case, error)
      if (.not. allocated(error)) call check_team(case%threads, error)
      if (.not. allocated(error)) call check_output(output, arguments, scene, error)
      if (.not. allocated(error)) call take_lock(output//".lock", warn, error)
      if (allocated(error)) return
      call check_checkpoint(output//".checkpoint", arguments%resume, error)
      if (.not. allocated(error)) call run_to(output, scene, case, text, keys, arguments, error)
      call give_lock_back()
   end subroutine run

   subroutine run_to(output, scene, case, text, keys, arguments, error)
      character(len=*), intent(in) :: output, scene
      type(case_t), intent(in), target :: case
      character(len=*), intent(in) :: text  !! case text, with the command-line options applied
      type(namelist_t), intent(in) :: keys  !! keys parsed from `text`
      type(arguments_t), intent(in) :: arguments
      type(error_t), allocatable, intent(out) :: error
      type(inputs_t), target :: inputs
      type(run_t), target :: state
      type(checkpoint_t) :: checkpoint

      call read_scene(scene, case, keys, inputs, error)
      if (allocated(error)) return
      if (lines_outside(case, inputs%arrays%grid) /= "") &
         call warn("no boulder can cross "//lines_outside(case, inputs%arrays%grid)//": outside the terrain")
      checkpoint%output = output
      checkpoint%store%name = hidden_name(output)//".crossings"
      checkpoint%name = output//".checkpoint"
      checkpoint%case => case
      checkpoint%text = text
      checkpoint%inputs => inputs
      checkpoint%every = arguments%checkpoint
      checkpoint%resumes = arguments%resume
      checkpoint%overwrites = arguments%overwrite
      checkpoint%say => warn
      call run_case(case, inputs%arrays%grid, inputs%scene, arguments%shard, checkpoint, state, error)
      if (.not. allocated(error)) then
         call write_part(output, temporary_name(output), case, text, inputs, state, checkpoint%store, error)
         if (allocated(error)) call name_checkpoint(checkpoint, error)
      end if
      if (allocated(error)) return
      call remove_checkpoint(checkpoint)
      call warn_of_breakage(case, state)
      if (arguments%quiet) return
      call summary(case, state, checkpoint%store)
      if (allocated(inputs%scene%grounds)) &
         call ground_summary(inputs%scene%grounds(:n_grounds(inputs%scene)), state%by_ground)
      write (output_unit, "(3a)") output, ": to get a result, run `rockfall merge ... --output OUT.nc`"
   end subroutine run_to

   subroutine print_help()
      character(len=*), parameter :: help(*) = [character(len=96) :: &
         "usage: rockfall-batch CASE [--scene FILE] [--output PART] [OPTION ...]", &
         "", &
         "Runs a case from `rockfall prepare` without Python: same results as `rockfall run`.", &
         "Writes a part file. `rockfall merge PART ... -o OUT.nc` turns one or more parts into a result.", &
         "", &
         "  --scene FILE         default: scene.nc next to the case", &
         "  -o, --output PART    default: CASE.partIofN in the current folder", &
         "  --boulders N         boulders from each source", &
         "  --boulders-total N   boulders from all sources together", &
         "  --seed N             random seed", &
         "  --threads N          number of threads; 0 = all cores", &
         "  --shard I/N          run part I of N", &
         "  --checkpoint SECONDS time between checkpoints in PART.checkpoint; default: 60, 0 = none", &
         "  --overwrite          replace existing outputs, never inputs", &
         "  --resume             continue from the last checkpoint, also one of `rockfall run`", &
         "  --quiet              print no summary", &
         "  -h, --help, --version", &
         "", &
         "Exit status: 0 done, 2 wrong input, 1 internal error, 130 and 143 stopped by Ctrl-C or", &
         "SIGTERM: completed boulders are in PART.checkpoint, continue with --resume."]
      integer :: k

      write (output_unit, "(a)") (trim(help(k)), k=1, size(help))
   end subroutine print_help

   !> Refuse an output that cannot be written, is an input, or exists without --overwrite. `check_checkpoint` decides
   !> whether the result of a stopped run may be replaced; with --resume, the run itself decides.
   subroutine check_output(output, arguments, scene, error)
      character(len=*), intent(in) :: output, scene
      type(arguments_t), intent(in) :: arguments
      type(error_t), allocatable, intent(out) :: error

      if (is_folder(output)) then
         call fail(error, output//": is a folder: give a file name")
      else if (.not. is_folder(folder_of(output)//".")) then
         call fail(error, output//": folder "//folder_of(output)//" does not exist")
      else if (same_file(output, arguments%case) .or. same_file(output, scene)) then
         call fail(error, output//": is an input; not overwritten")
      else if (path_exists(output) .and. .not. is_regular(output)) then
         call fail(error, output//": is not a regular file")
      else if (path_exists(output) .and. .not. (arguments%overwrite .or. arguments%resume .or. &
                                                path_exists(output//".checkpoint"))) then
         call fail(error, output//": already exists; not overwritten (--overwrite replaces it)")
      end if
      if (.not. allocated(error)) call check_place(output, error)
   end subroutine check_output

   !> Names of the evaluation lines completely outside the terrain, separated by commas.
   pure function lines_outside(case, grid) result(names)
      type(case_t), intent(in) :: case
      type(grid_t), intent(in) :: grid
      character(len=:), allocatable :: names
      integer :: k

      names = ""
      do k = 1, size(case%lines)
         if (is_outside(grid, case%lines(k)%x, case%lines(k)%y)) names = names//", "//case%lines(k)%name
      end do
      if (names /= "") names = names(3:)
   end function lines_outside

   !> Print the main results.
   subroutine summary(case, state, store)
      type(case_t), intent(in) :: case
      type(run_t), intent(in) :: state
      type(spilled_crossings_t), intent(in) :: store
      integer(i8) :: ended(size(statuses))
      integer :: k

      ended = [(count(state%status == k, kind=i8), k=1, size(statuses))]
      if (allocated(state%number)) ended = state%samples%ended
      if (case%title /= "") write (output_unit, "(a)") case%title
      write (output_unit, "(i0,a,*(4a))") state%boulders, " boulders", &
         (merge(": ", ", ", k == 1), percent(ended(k), state%boulders), " ", trim(statuses(k)), k=1, size(statuses))
      call line_summaries(case%lines, state, store)
      associate (counts => state%count)
         write (output_unit, "(i0,a,5(i0,a))") counts(1), " rebounds: ", counts(2), " redrawn, ", &
            counts(3), " limited, ", counts(4), &
            " with R_b/R_m outside their impact set (0.5 to 5.5) or impact table, ", counts(5), &
            " at speeds, ", counts(6), " at angles outside the fitted range of the set"
      end associate
      write (output_unit, "(4a,i0,a)") decimal(state%wall, 2), " s (", decimal(state%cpu, 2), &
         " s of CPU, ", state%threads, " threads)"
   end subroutine summary

   !> Warn of boulders whose fragments were limited.
   subroutine warn_of_breakage(case, state)
      type(case_t), intent(in) :: case
      type(run_t), intent(in) :: state
      integer, parameter :: capped = findloc(row_integers, "breakages_capped", dim=1)
      integer :: n

      if (.not. allocated(case%breakage)) return
      n = count(state%integers(:, findloc(state%integer_columns, capped, dim=1)) > 0)
      if (n > 0) call warn(integer_text(n)//" of "//integer_text(state%boulders)//" boulders reached &breakage " &
                           //"max_fragments = "//integer_text(case%breakage%max_fragments) &
                           //": further breakage was omitted")
   end subroutine warn_of_breakage

   !> Print the ground types and their rebounds.
   subroutine ground_summary(grounds, rebounds)
      type(ground_t), intent(in) :: grounds(:)
      integer(i8), intent(in) :: rebounds(:)
      integer :: k

      do k = 1, size(grounds)
         write (output_unit, "(3a,i0,3a)") "ground ", grounds(k)%name, ": ", rebounds(k), " rebounds (", &
            percent(rebounds(k), sum(rebounds)), ")"
      end do
   end subroutine ground_summary

   pure function percent(part, whole) result(text)
      integer(i8), intent(in) :: part, whole
      character(len=:), allocatable :: text

      text = decimal(100.0_wp*part/max(1_i8, whole), 1)//" %"
   end function percent

   !> Print how many boulders crossed each line.
   subroutine line_summaries(lines, state, store)
      type(case_line_t), intent(in) :: lines(:)
      type(run_t), intent(in) :: state
      type(spilled_crossings_t), intent(in) :: store
      integer(i8) :: n(size(lines))           !! number of boulders
      real(wp) :: total(2, size(lines))       !! sums of speeds [m/s] and of passing heights [m]
      integer :: k

      call add_up_crossings(state, store, n, total)
      do k = 1, size(lines)
         if (n(k) == 0) then
            write (output_unit, "(3a)") "line ", lines(k)%name, ": no boulder"
         else
            write (output_unit, "(3a,i0,7a)") "line ", lines(k)%name, ": ", n(k), " boulders (", &
               percent(n(k), state%boulders), "), mean speed ", decimal(total(1, k)/n(k), 2), &
               " m/s, mean passing height ", decimal(total(2, k)/n(k), 2), " m"
         end if
      end do
   end subroutine line_summaries

   !> Sum up the boulders that crossed each line: in one pass over all rows, or from the samples.
   subroutine add_up_crossings(state, store, n, total)
      type(run_t), intent(in) :: state
      type(spilled_crossings_t), intent(in) :: store
      integer(i8), intent(out) :: n(:)
      real(wp), intent(out) :: total(:, :)
      integer, parameter :: quantity(2) = [findloc(line_quantity, "speed", dim=1), &
                                           findloc(line_quantity, "passing_height", dim=1)]
      type(crossing_rows_t) :: rows
      integer :: k, q
      logical :: good

      n = 0
      total = 0
      if (allocated(state%number)) then
         do k = 1, size(n)
            n(k) = sample_size(state%samples, 1, k + 1)
            total(:, k) = [(sample_sum(state%samples, quantity(q), k + 1)/units_of(quantity(q), 1), q=1, 2)]
         end do
         return
      end if
      do k = 1, merge(size(store%size), 0, store%n > 0)
         call store%read_block(k, state%crossings, rows, good)
         if (good) call add_rows(rows, n, total)
      end do
      call add_rows(state%crossings, n, total)
   end subroutine add_up_crossings

   !> Count rows and sum their speeds and heights.
   subroutine add_rows(rows, n, total)
      type(crossing_rows_t), intent(in) :: rows
      integer(i8), intent(inout) :: n(:)
      real(wp), intent(inout) :: total(:, :)
      integer, parameter :: along_x = findloc(crossing_fields, "velocity_x", dim=1), &
                            passing = findloc(crossing_fields, "passing_height", dim=1)
      integer(i8) :: j
      integer :: k, q

      do j = 1, rows%n
         k = rows%line(j) + 1
         n(k) = n(k) + 1
         total(:, k) = total(:, k) + [norm2([(real(rows%real(along_x + q)%of(j), wp), q=0, 2)]), &
                                      real(rows%real(passing)%of(j), wp)]
      end do
   end subroutine add_rows
end program rockfall_batch
