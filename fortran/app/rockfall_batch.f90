! SPDX-License-Identifier: BSD-3-Clause
!> What a procedure without an error may say.
module warnings
   use, intrinsic :: iso_fortran_env, only: error_unit
   implicit none

contains

   subroutine warn(message)
      character(len=*), intent(in) :: message

      write (error_unit, "(2a)") "rockfall-batch: warning: ", message
      flush (error_unit)
   end subroutine warn
end module warnings

!> The standalone program: reads a case, runs it, writes its results. Only here anything is printed,
!> or stopped.
program rockfall_batch
   use, intrinsic :: iso_fortran_env, only: error_unit, output_unit
   use rockfall_kinds, only: wp, i8
   use rockfall_error, only: error_t, fail
   use rockfall_paths, only: version
   use rockfall_case, only: case_t
   use rockfall_override, only: read_case_file, bare_case_text
   use rockfall_filesystem, only: fail_beyond_size_limit, open_closed_streams, end_at_once
   use rockfall_interrupts, only: note_interrupts
   use rockfall_lock, only: lock_t, unlock_folder
   use rockfall_threads, only: check_team
   use rockfall_console, only: arguments_t, read_arguments, value_of, read_shard, read_seconds, read_logical, &
                               stem, one_line, decimal
   use rockfall_text, only: integer_text
   use rockfall_wholefolder, only: check_folder, listed_files
   use rockfall_load, only: inputs_t, load, refuse_input, lines_outside
   use rockfall_simulate, only: results_t, simulate, rebound_counts
   use rockfall_checkpoint, only: checkpoint_t, lock_checkpoint, check_checkpoint, checkpoint, remove_checkpoint
   use rockfall_variables, only: statuses, boulder_counts
   use rockfall_results, only: write_folder, result_files
   use warnings, only: warn
#ifdef HAVE_NETCDF
   use rockfall_ncresult, only: check_netcdf, write_netcdf
#endif
   implicit none

#ifdef HAVE_NETCDF
   character(len=*), parameter :: netcdf_word = "with netCDF"
#else
   character(len=*), parameter :: netcdf_word = "without netCDF"
#endif

   character(len=*), parameter :: keys(*) = &
                                  [character(len=10) :: "output", "boulders", "seed", "threads", "shard", &
                                   "checkpoint", "resume"]

   integer :: code
   logical :: half_written

   call main(code, half_written)
   flush (error_unit)
   if (half_written) call end_at_once(code)  ! HDF5 would try once more, and crash
   if (code /= 0) stop code, quiet=.true.

contains

   !> All variables live here, and are gone before the program stops.
   subroutine main(code, half_written)
      integer, intent(out) :: code
      logical, intent(out) :: half_written  !! a netCDF file could not be finished
      type(arguments_t) :: arguments
      type(error_t), allocatable :: error

      call open_closed_streams()
      call fail_beyond_size_limit()
      call note_interrupts()
      call read_arguments("rockfall-batch", keys, arguments, error)
      half_written = .false.
      code = 0
      if (arguments%help) then
         call print_help()
      else if (arguments%version) then
         write (output_unit, "(4a)") "rockfall-batch ", version, ", ", netcdf_word
      else if (.not. allocated(error)) then
         call check_team(1, error)  ! before the stack is needed
         if (.not. allocated(error)) call run(arguments, half_written, error)
      end if
      if (.not. allocated(error)) return
      code = error%code
      write (error_unit, "(2a)") "rockfall-batch: ", one_line(error%message)
   end subroutine main

   subroutine run(arguments, half_written, error)
      type(arguments_t), intent(in) :: arguments
      logical, intent(inout) :: half_written
      type(error_t), allocatable, intent(out) :: error
      type(case_t) :: case
      type(lock_t) :: lock
      character(len=:), allocatable :: output, folder, text
      integer(i8) :: shard(2)
      real(wp) :: every  !! seconds from a checkpoint to the next
      logical :: resume, one_file  !! a netCDF file, not a folder

      every = 60
      resume = .false.
      call read_shard(value_of(arguments, "shard"), shard, error)
      if (.not. allocated(error)) call read_seconds("checkpoint", value_of(arguments, "checkpoint"), every, error)
      if (.not. allocated(error)) call read_logical("resume", value_of(arguments, "resume"), resume, error)
      if (allocated(error)) return
      output = without_slash(value_of(arguments, "output"))
      one_file = shard(2) > 1 .or. is_netcdf(output)
      if (output == "" .and. shard(2) > 1) then
         output = stem(arguments%case)//".part"//integer_text(shard(1))//"of"//integer_text(shard(2))
      else if (output == "") then
         output = stem(arguments%case)//"_results"
      end if
      folder = output//".checkpoint"
      call read_case_file(arguments%case, value_of(arguments, "boulders"), &
                          value_of(arguments, "seed"), value_of(arguments, "threads"), text, &
                          case, error)
      if (.not. allocated(error)) call check_team(case%threads, error)
      if (.not. allocated(error)) call check_output(output, one_file, case, error)
      if (.not. allocated(error)) call lock_checkpoint(folder, warn, lock, error)
      if (allocated(error)) return
      call check_checkpoint(folder, resume, error)
      if (.not. allocated(error)) then
         call run_to(output, one_file, text, case, shard, folder, every, arguments%quiet, half_written, error)
      end if
      call unlock_folder(lock)
   end subroutine run

   !> The run, with a folder for its checkpoints to itself.
   subroutine run_to(output, one_file, text, case, shard, folder, every, quiet, half_written, error)
      character(len=*), intent(in) :: output, folder
      logical, intent(in) :: one_file       !! a netCDF file, not a folder
      character(len=*), intent(in) :: text  !! of the case, as it is run
      type(case_t), intent(in) :: case
      integer(i8), intent(in) :: shard(2)
      real(wp), intent(in) :: every         !! from a checkpoint to the next [s]
      logical, intent(in) :: quiet
      logical, intent(inout) :: half_written
      type(error_t), allocatable, intent(out) :: error
      type(inputs_t), target :: inputs
      type(results_t), target :: results
      type(checkpoint_t) :: saved

      call load(case, inputs, error)
      if (allocated(error)) return
      if (lines_outside(case, inputs%grid) /= "") &
         call warn("no boulder can cross "//lines_outside(case, inputs%grid)//": outside the terrain")
      saved = checkpoint(folder, every, bare_case_text(text), inputs%files, warn)
      call simulate(case, inputs, shard, saved, results, error)
      if (.not. allocated(error)) then
         call write_output(output, one_file, text, case, inputs, results, error)
         half_written = allocated(error) .and. one_file
      end if
      if (.not. allocated(error)) call remove_checkpoint(saved)
      if (allocated(error) .or. quiet) return
      call summary(case, results)
      write (output_unit, "(2a)") "results in ", output
   end subroutine run_to

   pure function without_slash(path)
      character(len=*), intent(in) :: path
      character(len=:), allocatable :: without_slash

      without_slash = path
      if (len(path) > 1 .and. path(len(path):) == "/") without_slash = path(:len(path) - 1)
   end function without_slash

   subroutine print_help()
      character(len=*), parameter :: help(*) = [character(len=96) :: &
         "usage: rockfall-batch CASE [key=value ...]", &
         "", &
         "Runs a case: the same case file as `rockfall run`, the same numbers, no Python.", &
         "Rasters are ESRI ASCII grids or netCDF; `rockfall prepare` makes such a case.", &
         "", &
         "  output=FOLDER   tables (CSV), maps (ESRI ASCII); default: name of the case, _results", &
         "  output=FILE.nc  one netCDF file, as `rockfall run` writes it", &
         "  boulders=N      released from each source, instead of the case's number", &
         "  seed=N          of the random numbers, instead of the case's", &
         "  threads=N       0 = all cores", &
         "  shard=I/N       the I-th of N parts, to one netCDF file, default: name of the case, .partIofN;", &
         "                  `rockfall merge` joins them", &
         "  checkpoint=S    seconds between checkpoints, in OUTPUT.checkpoint; default: 60, 0 = none", &
         "  resume=true     go on from the last checkpoint, if any", &
         "  quiet=true      no summary", &
         "  --help, --version", &
         "", &
         "Impact sets are looked for among those shipped, then beside the case.", &
         "Exit status: 0 done, 2 the input is wrong, 1 a fault of ours, 130 and 143", &
         "stopped by Ctrl-C or SIGTERM: boulders done are in OUTPUT.checkpoint, resume=true goes on."]
      integer :: k

      write (output_unit, "(a)") (trim(help(k)), k=1, size(help))
   end subroutine print_help

   ! ---- output -------------------------------------------------------------------------------

   pure logical function is_netcdf(output)
      character(len=*), intent(in) :: output

      is_netcdf = .false.
      if (len(output) > 3) is_netcdf = output(len(output) - 2:) == ".nc"
   end function is_netcdf

   !> Refuse a place where nothing can be written, or where the case reads, before the run and not after it.
   subroutine check_output(output, one_file, case, error)
      character(len=*), intent(in) :: output
      logical, intent(in) :: one_file
      type(case_t), intent(in) :: case
      type(error_t), allocatable, intent(out) :: error
      character(len=200), allocatable :: files(:), former(:)
      integer :: k

      if (.not. one_file) then
         files = result_files(case)
         call listed_files(output, former)
         files = [files, former]
         call check_folder(output, files, error)
         do k = 1, size(files)
            if (allocated(error)) return
            call refuse_input(case, output//"/"//trim(files(k)), error)
         end do
      else
         call refuse_input(case, output, error)
         if (allocated(error)) return
#ifdef HAVE_NETCDF
         call check_netcdf(output, error)
#else
         call fail(error, "output = "//output &
                   //": this program was built without netCDF; give a folder")
#endif
      end if
   end subroutine check_output

   subroutine write_output(output, one_file, text, case, inputs, results, error)
      character(len=*), intent(in) :: output, text
      logical, intent(in) :: one_file
      type(case_t), intent(in) :: case
      type(inputs_t), intent(in) :: inputs
      type(results_t), intent(in) :: results
      type(error_t), allocatable, intent(out) :: error

#ifdef HAVE_NETCDF
      if (one_file) then
         call write_netcdf(output, text, case, inputs, results, error)
         return
      end if
#endif
      call write_folder(output, text, case, inputs, results, error)
   end subroutine write_output

   !> What a user wants to see first.
   subroutine summary(case, results)
      type(case_t), intent(in) :: case
      type(results_t), intent(in) :: results
      integer(i8) :: ended(size(statuses)), counts(size(boulder_counts)), b
      integer :: k

      if (case%title /= "") write (output_unit, "(a)") case%title
      ended = 0
      do b = 1, results%boulders
         associate (status => results%fate(b)%status)
            ended(status) = ended(status) + 1
         end associate
      end do
      write (output_unit, "(i0,a,*(4a))") results%boulders, " boulders", &
         (merge(": ", ", ", k == 1), percent(ended(k), results%boulders), " ", trim(statuses(k)), &
          k=1, size(statuses))
      do k = 1, size(case%lines)
         call line_summary(case%lines(k)%name, k, results)
      end do
      counts = rebound_counts(results)
      write (output_unit, "(i0,a,5(i0,a))") counts(3), " rebounds; ", counts(4), " redrawn, ", &
         counts(5), " forced, ", counts(6), &
         " with R_b/R_m outside 0.5 to 5.5, where no set is calibrated; ", counts(7), &
         " at speeds, ", counts(8), " at angles outside those that the set was fitted on"
      write (output_unit, "(4a,i0,a)") decimal(results%wall, 2), " s (", decimal(results%cpu, 2), &
         " s of CPU, ", results%threads, " threads)"
   end subroutine summary

   pure function percent(part, whole) result(text)
      integer(i8), intent(in) :: part, whole
      character(len=:), allocatable :: text

      text = decimal(100.0_wp*part/max(1_i8, whole), 1)//" %"
   end function percent

   subroutine line_summary(name, k, results)
      character(len=*), intent(in) :: name
      integer, intent(in) :: k
      type(results_t), intent(in) :: results
      real(wp) :: speed, height
      integer(i8) :: n, b

      n = 0
      speed = 0
      height = 0
      do b = 1, results%boulders
         associate (crossing => results%crossing(k, b))
            if (.not. crossing%crossed) cycle
            n = n + 1
            speed = speed + norm2(crossing%v)
            height = height + crossing%passing_height
         end associate
      end do
      if (n == 0) then
         write (output_unit, "(3a)") "line ", name, ": no boulder"
      else
         write (output_unit, "(3a,i0,7a)") "line ", name, ": ", n, " boulders (", &
            percent(n, results%boulders), "), mean speed ", decimal(speed/n, 2), &
            " m/s, mean passing height ", decimal(height/n, 2), " m"
      end if
   end subroutine line_summary
end program rockfall_batch
