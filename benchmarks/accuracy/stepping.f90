! SPDX-License-Identifier: BSD-3-Clause
!> Runs a case with flights in time steps, and compares single flights with exact flights from the same start. Prints
!> `name value` lines; results are written to a part file as by rockfall-batch.
!>
!>     stepping CASE SCENE SCHEME STEP REPEAT FLIGHTS PART
program stepping
   use, intrinsic :: iso_fortran_env, only: error_unit
   use rockfall_kinds, only: wp, i8
   use rockfall_error, only: error_t, fail
   use rockfall_terrain, only: locate, height, gradient
   use rockfall_flight, only: flight_t, landing_t, launch_rate, fly_exactly, march, choose, scheme_names
   use rockfall_outcome, only: boulder_result_t
   use rockfall_scratch, only: scratch_t
   use rockfall_record, only: vertex_t
   use rockfall_ensemble, only: trace_boulder
   use rockfall_case, only: case_t
   use rockfall_case_file, only: read_case_file
   use rockfall_scene_file, only: inputs_t, read_scene
   use rockfall_part_file, only: write_part
   use rockfall_checkpoint, only: checkpoint_t
   use rockfall_variables, only: row_integers
   use rockfall_run_state, only: run_t, close_run
   use rockfall_run_loop, only: run_case
   implicit none

   !> Sums over flights from the same start of differences, stepped minus exact.
   type :: errors_t
      integer(i8) :: flights = 0
      integer(i8) :: short = 0             !! number of exact flights that end within the first step
      integer(i8) :: missed = 0            !! number of flights whose first contact was missed by the steps
      real(wp) :: place2 = 0.0_wp          !! squared distance of the landings [m2]
      real(wp) :: normal = 0.0_wp          !! difference of normal speed at the landing [m/s]
      real(wp) :: normal2 = 0.0_wp         !! square of this difference [m2/s2]
      real(wp) :: gained = 0.0_wp          !! energy at the landing minus energy at the start, per mass [m2/s2]
      real(wp) :: kinetic = 0.0_wp         !! exact kinetic energy at the landing, per mass [m2/s2]
      real(wp) :: deepest = 0.0_wp         !! maximum depth below the ground at a landing [m]
   end type errors_t

   type(error_t), allocatable :: error

   call run(error)
   if (allocated(error)) then
      write (error_unit, "(2a)") "stepping: ", error%message
      stop error%code, quiet=.true.
   end if

contains

   subroutine run(error)
      type(error_t), allocatable, intent(out) :: error
      type(case_t), target :: case
      type(inputs_t), target :: inputs
      integer, parameter :: impacts = findloc(row_integers, "impacts", dim=1)
      type(run_t), target :: state
      type(checkpoint_t) :: none  !! never saves, because `every` is 0
      character(len=:), allocatable :: text, scheme, part
      real(wp) :: step, cpu
      integer :: k

      scheme = word(3)
      step = number(4)
      part = word(7)
      if (.not. any(scheme_names == scheme) .or. (scheme /= "exact" .and. .not. step > 0)) then
         call fail(error, "needs a scheme and a step above 0; see the head of stepping.f90")
         return
      end if
      call read_case_file(word(1), "", "", "", "1", text, case, error)
      if (.not. allocated(error)) call read_scene(word(2), case, text, inputs, error)
      if (allocated(error)) return
      none%name = part//".checkpoint"
      none%every = 0.0_wp
      call choose(scheme, step)
      cpu = huge(cpu)
      do k = 1, max(1, nint(number(5)))
         call close_run(state)
         call run_case(case, inputs%arrays%grid, inputs%scene, [1_i8, 1_i8], none, state, error)
         if (allocated(error)) return
         cpu = min(cpu, state%cpu)
      end do
      print "(a,es24.16)", "cpu", cpu
      print "(a,i0)", "contacts ", sum(int(state%integers(:, impacts), i8))
      call write_part(part, part//".new", case, text, inputs, state, error)
      if (.not. allocated(error) .and. scheme /= "exact") &
         call compare(scheme, step, inputs, min(state%boulders, nint(number(6), i8)))
   end subroutine run

   !> Word of the command line.
   function word(k) result(text)
      integer, intent(in) :: k
      character(len=:), allocatable :: text
      integer :: length

      call get_command_argument(k, length=length)
      allocate (character(len=length) :: text)
      call get_command_argument(k, text)
   end function word

   !> Number of the command line; 0 if absent.
   real(wp) function number(k)
      integer, intent(in) :: k
      character(len=:), allocatable :: text
      integer :: status

      text = word(k)
      read (text, *, iostat=status) number
      if (status /= 0) number = 0
   end function number

   !> Repeat by the scheme each flight of the exact run of the first `boulders` boulders.
   subroutine compare(scheme, step, inputs, boulders)
      character(len=*), intent(in) :: scheme
      real(wp), intent(in) :: step  !! [s]
      type(inputs_t), intent(in) :: inputs
      integer(i8), intent(in) :: boulders
      type(errors_t) :: errors
      type(boulder_result_t) :: fate
      type(scratch_t) :: scratch
      integer(i8) :: b
      integer :: k

      do b = 1, boulders
         call choose("exact", step)
         call trace_boulder(inputs%scene, b, inputs%scene%max_impacts + 3, fate, scratch)
         call choose(scheme, step)
         do k = 1, scratch%record%n - 1
            call compare_flight(inputs, scratch%record%vertex(k), step, errors)
         end do
      end do
      associate (n => real(max(1_i8, errors%flights), wp))
         print "(a,i0)", "flights ", errors%flights
         print "(a,es24.16)", "short", errors%short/n, "missed", errors%missed/n, &
            "place", sqrt(errors%place2/n), "normal", errors%normal/n, "normal_rms", sqrt(errors%normal2/n), &
            "gained", errors%gained/errors%kinetic, "deepest", errors%deepest
      end associate
   end subroutine compare

   !> Add the errors of a flight that starts at a recorded contact, unless it leaves the terrain.
   subroutine compare_flight(inputs, contact, step, errors)
      type(inputs_t), intent(in) :: inputs
      type(vertex_t), intent(in) :: contact
      real(wp), intent(in) :: step  !! [s]
      type(errors_t), intent(inout) :: errors
      type(flight_t) :: start
      type(landing_t) :: exact, stepped
      real(wp) :: u, w, lift, g, normal, change, kinetic(2)

      g = inputs%scene%gravity
      start%x = contact%x
      start%y = contact%y
      start%z = contact%z
      start%v = contact%v
      associate (dem => inputs%scene%dem)
         call locate(dem, start%x, start%y, start%patch, u, w)
         start%above = max(0.0_wp, start%z - height(start%patch, u, w))
         start%rate = launch_rate(dem, start%patch, u, w, start%v)
         call fly_exactly(dem, g, start, exact)
         call march(dem, g, start, stepped, lift)
      end associate
      if (.not. (exact%contact .and. stepped%contact)) return
      call arrival(inputs, start, exact, kinetic(1), normal)
      call arrival(inputs, start, stepped, kinetic(2), change)
      change = change - normal
      errors%flights = errors%flights + 1
      if (exact%time < step) errors%short = errors%short + 1
      if (stepped%time > exact%time + step) errors%missed = errors%missed + 1
      errors%place2 = errors%place2 &
                      + sum(([stepped%x, stepped%y, stepped%z] - [exact%x, exact%y, exact%z])**2)
      errors%normal = errors%normal + change
      errors%normal2 = errors%normal2 + change**2
      errors%gained = errors%gained + kinetic(2) + g*(stepped%z - start%z) - 0.5_wp*sum(start%v**2)
      errors%kinetic = errors%kinetic + kinetic(1)
      errors%deepest = max(errors%deepest, lift)
   end subroutine compare_flight

   !> Kinetic energy per mass [m2/s2] and speed towards the ground [m/s] at a landing.
   subroutine arrival(inputs, start, landing, kinetic, normal)
      type(inputs_t), intent(in) :: inputs
      type(flight_t), intent(in) :: start
      type(landing_t), intent(in) :: landing
      real(wp), intent(out) :: kinetic, normal
      real(wp) :: v(3), slope(2)

      v = start%v
      v(3) = v(3) - inputs%scene%gravity*landing%time
      slope = gradient(inputs%scene%dem, landing%patch, landing%u, landing%w)
      kinetic = 0.5_wp*sum(v**2)
      normal = (dot_product(slope, v(1:2)) - v(3))/sqrt(1 + sum(slope**2))
   end subroutine arrival
end program stepping
