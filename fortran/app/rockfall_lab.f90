! SPDX-License-Identifier: BSD-3-Clause
!> The laboratory as a program: reads its case, packs the layers, fires all impacts, writes a table
!> of them. Only here anything is printed, or stopped.
program rockfall_lab
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use, intrinsic :: iso_fortran_env, only: error_unit, output_unit
   use rockfall_kinds, only: wp, i8
   use rockfall_error, only: error_t, fail
   use rockfall_textfile, only: read_text, integer_text, excerpt
   use rockfall_decimal, only: parse_integer, real_text, decimal_ok
   use rockfall_random, only: random_key
   use rockfall_threads, only: team_size, check_team, most_threads
   use rockfall_paths, only: version
   use rockfall_filesystem, only: path_exists, is_folder, fail_beyond_size_limit, open_closed_streams
   use rockfall_console, only: arguments_t, read_arguments, value_of, stem, one_line, decimal
   use rockfall_wholefile, only: whole_file_t, create_file, put, complete_file, discard_file
   use lab_packing, only: layer_t
   use lab_impact, only: shot_t, outcome_t, rebounded, lifted, captured, exploded, misfit
   use lab_ensemble, only: identity_t, pack_layers, fire_shots
   use lab_tables, only: outcome_fields, outcome_counts, outcome_row, outcome_count_row
   use lab_case, only: lab_case_t, read_lab_case, replace_integer, shot_of_ratio
   implicit none

   character(len=*), parameter :: keys(*) = &
      [character(len=7) :: "output", "points", "impacts", "seed", "threads"]
   integer(i8), parameter :: layers_at_once = 1024, shots_at_once = 32768  !! a bound to memory
   character(len=*), parameter :: first_columns = "ratio,point,impact"
   character(len=1), parameter :: line_end = achar(10)

   !> All impacts of a case.
   type :: impacts_t
      real(wp), allocatable :: outcome(:, :, :)  !! (outcome_fields, impact and point, ratio)
      integer, allocatable :: counts(:, :, :)    !! (outcome_counts, impact and point, ratio)
      integer :: threads = 0                     !! that did it
      real(wp) :: wall = 0, cpu = 0              !! that it took [s]
   end type impacts_t

   integer :: code

   call main(code)
   flush (error_unit)
   if (code /= 0) stop code, quiet=.true.

contains

   !> All variables live here, and are gone before the program stops.
   subroutine main(code)
      integer, intent(out) :: code
      type(arguments_t) :: arguments
      type(error_t), allocatable :: error

      call open_closed_streams()
      call fail_beyond_size_limit()
      call read_arguments("rockfall-lab", keys, arguments, error)
      code = 0
      if (arguments%help) then
         call print_help()
      else if (arguments%version) then
         write (output_unit, "(2a)") "rockfall-lab ", version
      else if (.not. allocated(error)) then
         call check_team(1, error)  ! before the stack is needed
         if (.not. allocated(error)) call run(arguments, error)
      end if
      if (.not. allocated(error)) return
      code = error%code
      write (error_unit, "(2a)") "rockfall-lab: ", one_line(error%message)
   end subroutine main

   subroutine run(arguments, error)
      type(arguments_t), intent(in) :: arguments
      type(error_t), allocatable, intent(out) :: error
      type(lab_case_t) :: case
      type(impacts_t) :: done
      character(len=:), allocatable :: output

      output = value_of(arguments, "output")
      if (output == "") output = stem(arguments%case)//".csv"
      call read_case(arguments, case, error)
      if (.not. allocated(error)) &
         call read_threads(value_of(arguments, "threads"), done%threads, error)
      if (.not. allocated(error)) call check_output(output, error)
      if (.not. allocated(error)) call fire_all(case, done, error)
      if (.not. allocated(error)) call write_table(output, case, done, error)
      if (allocated(error) .or. arguments%quiet) return
      call summary(case, done)
      write (output_unit, "(2a)") "impacts in ", output
   end subroutine run

   !> The case file, with values of the command line in place of its own.
   subroutine read_case(arguments, case, error)
      type(arguments_t), intent(in) :: arguments
      type(lab_case_t), intent(out) :: case
      type(error_t), allocatable, intent(out) :: error
      character(len=*), parameter :: plan(3) = [character(len=7) :: "seed", "points", "impacts"]
      character(len=:), allocatable :: text
      integer :: k

      call read_text(arguments%case, text, error)
      if (.not. allocated(error)) call read_lab_case(text, arguments%case, case, error)
      do k = 1, size(plan)
         if (allocated(error)) return
         call replace_integer(case, trim(plan(k)), value_of(arguments, trim(plan(k))), error)
      end do
   end subroutine read_case

   !> Threads that are used when `text` asks for some.
   subroutine read_threads(text, threads, error)
      character(len=*), intent(in) :: text  !! "": all cores
      integer, intent(out) :: threads
      type(error_t), allocatable, intent(out) :: error
      integer(i8) :: number
      integer :: status

      number = 0
      status = decimal_ok
      if (text /= "") call parse_integer(text, number, status)
      if (status /= decimal_ok .or. number < 0 .or. number > most_threads) then
         call fail(error, "threads = "//excerpt(text)//": must be 0 (all cores) to " &
                   //integer_text(most_threads))
         return
      end if
      call check_team(int(number), error)
      threads = team_size(int(max(0_i8, min(number, int(most_threads, i8)))))
   end subroutine read_threads

   subroutine print_help()
      character(len=*), parameter :: help(*) = [character(len=96) :: &
         "usage: rockfall-lab CASE [key=value ...]", &
         "", &
         "Fires all impacts of a laboratory case: the same case file as `rockfall lab impact`,", &
         "the same numbers, no Python.", &
         "", &
         "  output=FILE  table of the impacts (CSV); default: name of the case, .csv", &
         "  points=N     for each ratio, each on a layer of its own; instead of the case's", &
         "  impacts=N    at each point; instead of the case's", &
         "  seed=N       of the random numbers; instead of the case's", &
         "  threads=N    0 = all cores", &
         "  quiet=true   no summary", &
         "  --help, --version", &
         "", &
         "A row of the table is an impact; its status: 1 rebounded, 2 lifted, 3 captured,", &
         "4 exploded, 5 misfit. Only the first three are results.", &
         "Exit status: 0 done, 2 the input is wrong, 1 a fault of ours."]
      integer :: k

      write (output_unit, "(a)") (trim(help(k)), k=1, size(help))
   end subroutine print_help

   ! ---- impacts ------------------------------------------------------------------------------

   !> All impacts of the case. Refused when they do not fit in memory.
   subroutine fire_all(case, done, error)
      type(lab_case_t), intent(in) :: case
      type(impacts_t), intent(inout) :: done  !! its threads are given
      type(error_t), allocatable, intent(out) :: error
      type(layer_t), allocatable :: layers(:)
      real(wp) :: cpu_start, cpu_end
      integer(i8) :: first, at_once, start, end, rate
      integer :: ratios, status

      ratios = size(case%ratios)
      allocate (done%outcome(size(outcome_fields), case%impacts*case%points, ratios), stat=status)
      if (status == 0) allocate ( &
         done%counts(size(outcome_counts), case%impacts*case%points, ratios), stat=status)
      if (status /= 0) then
         call fail(error, case%file//": "//integer_text(ratios*case%points*case%impacts) &
                   //" impacts do not fit in memory")
         return
      end if
      call system_clock(start, rate)
      call cpu_time(cpu_start)
      at_once = max(1_i8, min(layers_at_once, shots_at_once/case%impacts))
      do first = 1, case%points, at_once
         allocate (layers(min(at_once, case%points - first + 1)))
         call pack_layers(case%packing, case%material, random_key(case%seed), first, &
                          done%threads, layers, error)
         if (allocated(error)) then
            error%message = case%file//": "//error%message
            return
         end if
         call fire_at(case, first, layers, done)
         deallocate (layers)
      end do
      call cpu_time(cpu_end)
      call system_clock(end)
      done%wall = real(end - start, wp)/rate
      done%cpu = cpu_end - cpu_start
   end subroutine fire_all

   !> All impacts at some points. A layer has the number of its point, and is hit nowhere else, so
   !> that the point is the first of its layer.
   subroutine fire_at(case, first, layers, done)
      type(lab_case_t), intent(in) :: case
      integer(i8), intent(in) :: first       !! number of the first layer
      type(layer_t), intent(in) :: layers(:)
      type(impacts_t), intent(inout) :: done
      type(identity_t), allocatable :: ids(:)
      type(shot_t), allocatable :: shots(:)
      type(outcome_t), allocatable :: outcomes(:)
      integer(i8) :: before
      integer :: k, n, r

      n = size(layers)*int(case%impacts)
      allocate (ids(n), shots(n), outcomes(n))
      do k = 1, n
         ids(k)%place = 1 + (k - 1)/int(case%impacts)
         ids(k)%layer = first + ids(k)%place - 1
         ids(k)%point = 1
         ids(k)%impact = 1 + mod(int(k - 1, i8), case%impacts)
      end do
      before = (first - 1)*case%impacts
      do r = 1, size(case%ratios)
         call fire_shots(layers, case%material, shot_of_ratio(case, case%ratios(r)), case%range, &
                         random_key(case%seed), ids, done%threads, shots, outcomes)
         do k = 1, n
            done%outcome(:, before + k, r) = outcome_row(shots(k), outcomes(k))
            done%counts(:, before + k, r) = outcome_count_row(outcomes(k))
         end do
      end do
   end subroutine fire_at

   ! ---- output -------------------------------------------------------------------------------

   !> Refuse a place where the table cannot be put, before the run and not after it, and to replace
   !> anything but a table.
   subroutine check_output(output, error)
      character(len=*), intent(in) :: output
      type(error_t), allocatable, intent(out) :: error
      type(whole_file_t) :: file

      if (is_folder(output)) then
         call fail(error, output//": is a folder; a file name is needed")
      else if (path_exists(output)) then
         if (.not. is_table(output)) &
            call fail(error, output//": is there, and no table of impacts; it is not overwritten")
      end if
      if (allocated(error)) return
      call create_file(output, file, error)
      if (.not. allocated(error)) call discard_file(file)
   end subroutine check_output

   !> Whether a file begins as a table of impacts.
   logical function is_table(path)
      character(len=*), intent(in) :: path
      character(len=len(first_columns)) :: start
      integer :: unit, status

      start = ""
      open (newunit=unit, file=path, access="stream", form="unformatted", status="old", &
            action="read", iostat=status)
      if (status == 0) then
         read (unit, iostat=status) start
         close (unit)
      end if
      is_table = status == 0 .and. start == first_columns
   end function is_table

   !> A row for each impact: ratio by ratio, point by point. Its numbers read back the same.
   subroutine write_table(output, case, done, error)
      character(len=*), intent(in) :: output
      type(lab_case_t), intent(in) :: case
      type(impacts_t), intent(in) :: done
      type(error_t), allocatable, intent(out) :: error
      type(whole_file_t) :: file
      character(len=:), allocatable :: row
      integer(i8) :: k
      integer :: r, f

      call create_file(output, file, error)
      if (allocated(error)) return
      row = first_columns
      do f = 1, size(outcome_fields)
         row = row//","//trim(outcome_fields(f))
      end do
      do f = 1, size(outcome_counts)
         row = row//","//trim(outcome_counts(f))
      end do
      call put(file, row//line_end, error)
      do r = 1, size(case%ratios)
         do k = 1, size(done%counts, 2, i8)
            if (allocated(error)) return
            row = real_text(case%ratios(r))//","//integer_text(1 + (k - 1)/case%impacts)//"," &
                  //integer_text(1 + mod(k - 1, case%impacts))
            do f = 1, size(outcome_fields)
               row = row//","//any_real_text(done%outcome(f, k, r))
            end do
            do f = 1, size(outcome_counts)
               row = row//","//integer_text(done%counts(f, k, r))
            end do
            call put(file, row//line_end, error)
         end do
      end do
      if (.not. allocated(error)) call complete_file(file, error)
   end subroutine write_table

   !> A number as text; what exploded may be none.
   pure function any_real_text(value) result(text)
      real(wp), intent(in) :: value
      character(len=:), allocatable :: text
      character(len=9) :: buffer

      if (ieee_is_finite(value)) then
         text = real_text(value)
      else
         write (buffer, "(f9.0)") value  ! NaN, Infinity, -Infinity
         text = trim(adjustl(buffer))
      end if
   end function any_real_text

   !> How the impacts of each ratio ended.
   subroutine summary(case, done)
      type(lab_case_t), intent(in) :: case
      type(impacts_t), intent(in) :: done
      integer, parameter :: ends(5) = [rebounded, lifted, captured, exploded, misfit]
      character(len=9), parameter :: words(5) = &
         [character(len=9) :: "rebounded", "lifted", "captured", "exploded", "misfit"]
      character(len=10) :: ratio
      integer :: k, r

      if (case%title /= "") write (output_unit, "(a)") case%title
      write (output_unit, "(a10,*(a12))") "R_b/R_m", "impacts", (trim(words(k)), k=1, size(words))
      do r = 1, size(case%ratios)
         ratio = real_text(case%ratios(r))
         write (output_unit, "(a10,*(i12))") trim(ratio), size(done%counts, 2, i8), &
            (count(done%counts(1, :, r) == ends(k), kind=i8), k=1, size(ends))
      end do
      write (output_unit, "(4a,i0,a)") decimal(done%wall, 2), " s (", decimal(done%cpu, 2), &
         " s of CPU, ", done%threads, " threads)"
   end subroutine summary
end program rockfall_lab
