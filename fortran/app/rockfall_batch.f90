! SPDX-License-Identifier: BSD-3-Clause
!> The standalone program: reads a case, runs it, writes its results. Only here anything is printed,
!> or stopped.
program rockfall_batch
   use, intrinsic :: ieee_arithmetic, only: ieee_is_nan
   use, intrinsic :: iso_fortran_env, only: error_unit, output_unit
   use rockfall_kinds, only: wp, i8
   use rockfall_error, only: error_t, fail
   use rockfall_textfile, only: lower, excerpt
   use rockfall_paths, only: version
   use rockfall_case, only: case_t
   use rockfall_override, only: read_case_file
   use rockfall_filesystem, only: name_of, fail_beyond_size_limit, end_at_once
   use rockfall_wholefolder, only: check_folder
   use rockfall_load, only: inputs_t, load, lines_outside
   use rockfall_simulate, only: results_t, simulate, rebound_counts
   use rockfall_variables, only: statuses, boulder_counts
   use rockfall_results, only: write_folder
#ifdef HAVE_NETCDF
   use rockfall_ncresult, only: check_netcdf, write_netcdf
#endif
   implicit none

#ifdef HAVE_NETCDF
   character(len=*), parameter :: netcdf_word = "with netCDF"
#else
   character(len=*), parameter :: netcdf_word = "without netCDF"
#endif

   type :: options_t
      character(len=:), allocatable :: case, output, boulders, seed, threads
      logical :: quiet = .false., only_help = .false.
   end type options_t

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
      type(options_t) :: options
      type(error_t), allocatable :: error

      call fail_beyond_size_limit()
      call read_arguments(options, error)
      half_written = .false.
      if (.not. allocated(error) .and. .not. options%only_help) &
         call run(options, half_written, error)
      code = 0
      if (.not. allocated(error)) return
      code = error%code
      write (error_unit, "(2a)") "rockfall-batch: ", one_line(error%message)
   end subroutine main

   subroutine run(options, half_written, error)
      type(options_t), intent(in) :: options
      logical, intent(inout) :: half_written
      type(error_t), allocatable, intent(out) :: error
      type(case_t) :: case
      type(inputs_t), target :: inputs
      type(results_t), target :: results
      character(len=:), allocatable :: text

      call read_case_file(options%case, options%boulders, options%seed, options%threads, text, &
                          case, error)
      if (.not. allocated(error)) call check_output(options%output, error)
      if (.not. allocated(error)) call load(case, inputs, error)
      if (allocated(error)) return
      if (lines_outside(case, inputs%grid) /= "") then
         write (error_unit, "(3a)") "rockfall-batch: warning: no boulder can cross ", &
            lines_outside(case, inputs%grid), ": outside the terrain"
      end if
      call simulate(case, inputs, results, error)
      if (.not. allocated(error)) then
         call write_output(options%output, text, case, inputs, results, error)
         half_written = allocated(error) .and. is_netcdf(options%output)
      end if
      if (allocated(error) .or. options%quiet) return
      call summary(case, results)
      write (output_unit, "(2a)") "results in ", options%output
   end subroutine run

   ! ---- arguments ----------------------------------------------------------------------------

   subroutine read_arguments(options, error)
      type(options_t), intent(out) :: options
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: word
      integer :: k

      options = options_t(case="", output="", boulders="", seed="", threads="")
      do k = 1, command_argument_count()
         word = argument(k)
         select case (word)
         case ("--help", "-h")
            call print_help()
            options%only_help = .true.
         case ("--version")
            write (output_unit, "(4a)") "rockfall-batch ", version, ", ", netcdf_word
            options%only_help = .true.
         case default
            call read_argument(word, options, error)
         end select
         if (allocated(error) .or. options%only_help) return
      end do
      if (options%case == "") &
         call fail(error, "a case file is needed: rockfall-batch CASE [key=value ...]; see --help")
      if (options%output == "") options%output = default_output(options%case)
   end subroutine read_arguments

   !> `key=value`, or the case file.
   subroutine read_argument(word, options, error)
      character(len=*), intent(in) :: word
      type(options_t), intent(inout) :: options
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: value
      integer :: equals

      equals = index(word, "=")
      value = word(equals + 1:)
      if (equals > 1 .and. value == "") then
         call fail(error, word//": a value is missing")
         return
      end if
      select case (word(:max(0, equals - 1)))
      case ("output"); options%output = without_slash(value)
      case ("boulders"); options%boulders = value
      case ("seed"); options%seed = value
      case ("threads"); options%threads = value
      case ("quiet")
         options%quiet = any(lower(value) == [character(len=6) :: "true", "t", ".true."])
         if (.not. options%quiet .and. &
             .not. any(lower(value) == [character(len=7) :: "false", "f", ".false."])) then
            call fail(error, "quiet = "//excerpt(value)//": must be true or false")
         end if
      case ("")
         if (word(:min(1, len(word))) == "-") then
            call fail(error, excerpt(word)//": unknown option; known: --help, --version")
         else if (options%case /= "") then
            call fail(error, excerpt(word)//": there is a case file already, "//options%case &
                      //"; options are key=value")
         end if
         options%case = word
      case default
         call fail(error, excerpt(word) &
                   //": unknown key; known: output, boulders, seed, threads, quiet")
      end select
   end subroutine read_argument

   function argument(k) result(word)
      integer, intent(in) :: k
      character(len=:), allocatable :: word
      integer :: length

      call get_command_argument(k, length=length)
      allocate (character(len=length) :: word)
      call get_command_argument(k, word)
   end function argument

   pure function without_slash(path)
      character(len=*), intent(in) :: path
      character(len=:), allocatable :: without_slash

      without_slash = path
      if (len(path) > 1 .and. path(len(path):) == "/") without_slash = path(:len(path) - 1)
   end function without_slash

   !> `folder/case.nml` -> `case_results` in the current folder.
   pure function default_output(case) result(output)
      character(len=*), intent(in) :: case
      character(len=:), allocatable :: output
      integer :: dot

      output = name_of(case)
      dot = index(output, ".", back=.true.)
      if (dot > 1) output = output(:dot - 1)
      output = output//"_results"
   end function default_output

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
         "  quiet=true      no summary", &
         "  --help, --version", &
         "", &
         "Impact sets are looked for in the folder ROCKFALL_SETS, then among those shipped, then", &
         "beside the case. Exit status: 0 done, 2 the input is wrong, 1 a fault of ours."]
      integer :: k

      write (output_unit, "(a)") (trim(help(k)), k=1, size(help))
   end subroutine print_help

   ! ---- output -------------------------------------------------------------------------------

   pure logical function is_netcdf(output)
      character(len=*), intent(in) :: output

      is_netcdf = .false.
      if (len(output) > 3) is_netcdf = output(len(output) - 2:) == ".nc"
   end function is_netcdf

   !> Refuse a place where nothing can be written, before the run and not after it.
   subroutine check_output(output, error)
      character(len=*), intent(in) :: output
      type(error_t), allocatable, intent(out) :: error

      if (.not. is_netcdf(output)) then
         call check_folder(output, error)
      else
#ifdef HAVE_NETCDF
         call check_netcdf(output, error)
#else
         call fail(error, "output = "//output &
                   //": this program was built without netCDF; give a folder")
#endif
      end if
   end subroutine check_output

   subroutine write_output(output, text, case, inputs, results, error)
      character(len=*), intent(in) :: output, text
      type(case_t), intent(in) :: case
      type(inputs_t), intent(in) :: inputs
      type(results_t), intent(in) :: results
      type(error_t), allocatable, intent(out) :: error

#ifdef HAVE_NETCDF
      if (is_netcdf(output)) then
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
      write (output_unit, "(i0,a,3(i0,a))") counts(3), " rebounds; ", counts(4), " redrawn, ", &
         counts(5), " forced, ", counts(6), &
         " with R_b/R_m outside 0.5 to 5.5, where no set is calibrated"
      write (output_unit, "(4a,i0,a)") decimal(results%wall, 2), " s (", decimal(results%cpu, 2), &
         " s of CPU, ", results%threads, " threads)"
   end subroutine summary

   pure function percent(part, whole) result(text)
      integer(i8), intent(in) :: part, whole
      character(len=:), allocatable :: text

      text = decimal(100.0_wp*part/max(1_i8, whole), 1)//" %"
   end function percent

   !> A number with so many decimals.
   pure function decimal(value, decimals) result(text)
      real(wp), intent(in) :: value
      integer, intent(in) :: decimals
      character(len=:), allocatable :: text
      character(len=40) :: buffer, form

      write (form, "(a,i0,a)") "(f40.", decimals, ")"
      write (buffer, form) value
      text = trim(adjustl(buffer))
   end function decimal

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

   !> A message without line ends.
   pure function one_line(message) result(text)
      character(len=*), intent(in) :: message
      character(len=len(message)) :: text
      integer :: i

      text = message
      do i = 1, len(text)
         if (iachar(text(i:i)) < 32) text(i:i) = " "
      end do
   end function one_line
end program rockfall_batch
