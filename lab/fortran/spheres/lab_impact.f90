! SPDX-License-Identifier: BSD-3-Clause
!> Impact of a spherical boulder on a layer, from the first contact until the boulder has finally left the layer, has
!> passed its peak (the maximum upward energy), has spent its energy, or the time is up. Velocities are (V_t, V_n, W) as
!> in the trajectory kernel: V_t is the horizontal speed, V_n > 0 away from the surface, and W = R_b omega about the
!> horizontal normal of V_t, > 0 for forward rolling. The turn of V_t is recorded separately.
module lab_impact
   use rockfall_kinds, only: wp
   use rockfall_error, only: error_t, fail
   use rockfall_math, only: degree, sine_cosine
   use lab_contact, only: material_t
   use lab_bodies, only: bodies_t, body_energy, body_position, body_velocity, body_reach, first_sphere
   use lab_packing, only: packing_t, layer_t, skin_factor, rocks_at_rest, largest_extent
   use lab_step, only: assembly_t, assemble, set_absorbing_base, advance, watch_energy, deepest_share, &
      safe_step, sound, leapt, step_too_long, energy_grew
   implicit none
   private
   public :: shot_t, state_t, outcome_t, fire, first_contact, check_shot, fits, will_meet
   public :: rebounded, lifted, rolled_on, exploded, misfit, status_names

   !> Outcomes of an impact. Only the first three count as results.
   integer, parameter :: rebounded = 1  !! left upwards on a clear path
   integer, parameter :: lifted = 2     !! lost contact upwards, but touched the layer again
   integer, parameter :: rolled_on = 3  !! stayed in contact: rolled or ploughed
   integer, parameter :: exploded = 4   !! unstable, see `trouble`; the outcome has no meaning
   integer, parameter :: misfit = 5     !! the sphere is too large for the periodic layer
   character(len=9), parameter :: status_names(5) = [character(len=9) :: &
      "rebounded", "lifted", "rolled_on", "exploded", "misfit"]

   !> Shot, and parameters of its simulation.
   type :: shot_t
      real(wp) :: radius = 1            !! R_b [m]
      real(wp) :: density = 2650        !! [kg/m3]
      real(wp) :: speed = 15            !! [m/s]
      real(wp) :: angle = 45            !! angle of the path to the surface, 90 = perpendicular [degrees]
      real(wp) :: spin = 0              !! W/V [-]
      real(wp) :: aim(2) = 0.5_wp       !! where the path meets the mean surface: x, y over the width [-]
      real(wp) :: heading(2) = [1.0_wp, 0.0_wp]  !! heading in plan, a unit vector [-]
      real(wp) :: gravity = 9.81_wp     !! [m/s2]
      real(wp) :: patience = 6         !! maximum duration, over (R_b + R_m)/speed [-]
      real(wp) :: spent = 1.0e-4_wp     !! fraction of the incident energy that counts as zero
      real(wp) :: past = 0.5_wp !! the peak is past if only this fraction of the maximum upward energy is left
      real(wp) :: wait = 0.5_wp              !! and this time has passed since the peak, over (R_b + R_m)/speed [-]
      real(wp) :: step_factor = 1.4_wp  !! step relative to `safe_step`; shots have retries, layers do not
      integer :: retries = 3            !! maximum number of halvings of a step that is too long
   end type shot_t

   !> Motion of the boulder at an instant.
   type :: state_t
      real(wp) :: v(3) = 0              !! (V_t, V_n, W) [m/s]
      real(wp) :: lateral = 0           !! sine of the turn of V_t, > 0 to the left [-]
   end type state_t

   type :: outcome_t
      integer :: status = 0
      integer :: trouble = sound
      real(wp) :: incoming(3) = 0       !! (V_t, V_n, W) at the first contact [m/s]
      type(state_t) :: peak             !! at maximum upward kinetic energy; at the end if there is none
      type(state_t) :: loss             !! at the first upward loss of contact; if none, as peak
      type(state_t) :: clear            !! when the path was clear; if never, as peak
      real(wp) :: duration = 0          !! time from the first contact to the peak [s]
      real(wp) :: travel = 0            !! distance along the heading, up to the peak [m]
      real(wp) :: depth = 0             !! maximum depth of the sphere's lowest point below the mean surface [m]
      real(wp) :: overlap = 0 !! maximum overlap over the smaller radius, sampled at intervals [-]
      integer :: halvings = 0           !! number of halvings of the step
      integer :: steps = 0
   end type outcome_t

   real(wp), parameter :: opening_gap = 1.0e-9_wp  !! gap between sphere and layer at the start, over R_b [-]
   integer, parameter :: max_retries = 30          !! reduces the step to 1e-9 of the initial one
   integer, parameter :: watch_interval = 32       !! steps between checks of the energy and of the exit path

contains

   !> Fire one shot: a pure function of its arguments.
   pure subroutine fire(layer, packing, material, shot, outcome)
      type(layer_t), intent(in) :: layer
      type(packing_t), intent(in) :: packing
      type(material_t), intent(in) :: material
      type(shot_t), intent(in) :: shot
      type(outcome_t), intent(out) :: outcome
      type(assembly_t) :: s
      real(wp) :: start(3), v(6), sine, cosine
      integer :: k

      v = incident(shot)
      call sine_and_cosine(shot, sine, cosine)
      outcome%incoming = shot%speed*[cosine, -sine, shot%spin]
      start = first_contact(layer, shot)
      if (.not. fits(layer, packing, shot%radius)) then
         outcome%status = misfit
         return
      end if
      do k = 0, shot%retries
         call load(layer, packing, material, shot, start, v, 0.5_wp**k, s)
         call follow(layer, packing, shot, s, outcome)
         outcome%halvings = k
         if (.not. any(s%trouble == [step_too_long, leapt, energy_grew])) exit
      end do
      outcome%trouble = s%trouble
      if (s%trouble /= sound) outcome%status = exploded
   end subroutine fire

   !> Check the parameters of a shot.
   pure subroutine check_shot(shot, error)
      type(shot_t), intent(in) :: shot
      type(error_t), allocatable, intent(out) :: error

      if (.not. (shot%radius > 0 .and. shot%density > 0)) then
         call fail(error, "impact: radius and density must be > 0")
      else if (.not. shot%speed > 0) then
         call fail(error, "impact: speed must be > 0 [m/s]")
      else if (.not. (shot%angle >= 1 .and. shot%angle <= 90)) then
         call fail(error, "impact: angle must be 1 to 90 degrees from the surface")
      else if (.not. (abs(shot%spin) < huge(1.0_wp) .and. all(abs(shot%aim - 0.5_wp) <= 0.5_wp))) then
         call fail(error, "impact: spin must be a number and aim 0 to 1")
      else if (.not. abs(sum(shot%heading**2) - 1) < 1.0e-6_wp) then
         call fail(error, "impact: heading must be a unit vector")
      else if (.not. min(shot%step_factor, shot%patience, shot%spent) > 0) then
         call fail(error, "impact: step_factor, patience and spent must be > 0")
      else if (.not. min(shot%gravity, shot%past, shot%wait, real(shot%retries, wp)) >= 0) then
         call fail(error, "impact: gravity, past, wait and retries must be >= 0")
      else if (shot%retries > max_retries) then
         call fail(error, "impact: retries must be at most 30")
      end if
   end subroutine check_shot

   !> Sine and cosine of the incidence angle.
   pure subroutine sine_and_cosine(shot, s, c)
      type(shot_t), intent(in) :: shot
      real(wp), intent(out) :: s, c  !! [-]

      if (shot%angle <= 45) then
         call sine_cosine(shot%angle*degree, s, c)
      else
         call sine_cosine((90 - shot%angle)*degree, c, s)
      end if
   end subroutine sine_and_cosine

   !> Velocity and spin before the impact, [m/s] and [rad/s].
   pure function incident(shot) result(v)
      type(shot_t), intent(in) :: shot
      real(wp) :: v(6), s, c

      call sine_and_cosine(shot, s, c)
      v(1:3) = shot%speed*[c*shot%heading(1), c*shot%heading(2), -s]
      v(4:6) = shot%speed*shot%spin/shot%radius*[-shot%heading(2), shot%heading(1), 0.0_wp]
   end function incident

   !> Centre of the sphere at its first contact with the layer, or the floor, on its straight path [m].
   pure function first_contact(layer, shot) result(centre)
      type(layer_t), intent(in) :: layer
      type(shot_t), intent(in) :: shot
      real(wp) :: centre(3)
      real(wp) :: d(3), p(3), q(3), v(6), along, square, reach, distance, far
      integer :: k, i, j, images

      v = incident(shot)
      d = v(1:3)/shot%speed
      p = [shot%aim*layer%box%width, layer%surface]
      distance = (p(3) - shot%radius)/(-d(3))  ! distance to the floor, from the aim along the path
      far = (abs(distance) + (layer%top + 2*shot%radius)/(-d(3)))*sqrt(d(1)**2 + d(2)**2)
      images = 2 + int((far + shot%radius)/layer%box%width)
      do k = 1, size(layer%radius)
         reach = layer%radius(k) + shot%radius
         do j = -images, images
            do i = -images, images
               q = layer%x(:, k) - p
               q(1:2) = q(1:2) + layer%box%width*[i, j]
               along = dot_product(q, d)
               square = dot_product(q, q) - along**2
               if (square < reach**2) distance = min(distance, along - sqrt(reach**2 - square))
            end do
         end do
      end do
      centre = p + d*(distance - opening_gap*shot%radius)
   end function first_contact

   !> Return whether the boulder is clear of its own image, and cannot touch two images of a rock.
   pure logical function fits(layer, packing, radius)
      type(layer_t), intent(in) :: layer
      type(packing_t), intent(in) :: packing
      real(wp), intent(in) :: radius  !! R_b [m]

      fits = max(3*radius, 2*(radius + largest_extent(layer) + skin_factor*packing%mean_radius)) &
         < layer%box%width
   end function fits

   !> Assemble layer and sphere for time stepping.
   pure subroutine load(layer, packing, material, shot, start, v, factor, s)
      type(layer_t), intent(in) :: layer
      type(packing_t), intent(in) :: packing
      type(material_t), intent(in) :: material
      type(shot_t), intent(in) :: shot
      real(wp), intent(in) :: start(3), v(6)  !! [m], [m/s] and [rad/s]
      real(wp), intent(in) :: factor          !! factor on the step [-]
      type(assembly_t), intent(out) :: s
      type(bodies_t) :: b
      real(wp) :: dt
      integer :: n

      n = size(layer%radius) + 1
      b = rocks_at_rest(layer, packing%density, reshape(start, [3, 1]), [shot%radius], shot%density)
      b%v(:, n) = v
      dt = factor*shot%step_factor*safe_step(material, minval(layer%radius), packing%density, shot%speed)
      call assemble(s, b, layer%box, material, shot%gravity, dt, skin_factor*packing%mean_radius, 1, &
                    body_energy(b, n) + shot%gravity*b%mass(n)*(layer%top + shot%radius))
      if (.not. packing%rigid_base) &
         call set_absorbing_base(s, packing%density*layer%solid*packing%base_speed)
   end subroutine load

   !> Follow the sphere until the end of the impact.
   pure subroutine follow(layer, packing, shot, s, outcome)
      type(layer_t), intent(in) :: layer
      type(packing_t), intent(in) :: packing
      type(shot_t), intent(in) :: shot
      type(assembly_t), intent(inout) :: s
      type(outcome_t), intent(inout) :: outcome
      real(wp) :: time, unit, nothing, best, travel
      integer :: n
      logical :: lost

      n = s%bodies%n
      unit = (shot%radius + packing%mean_radius)/shot%speed
      nothing = shot%spent*body_energy(s%bodies, n)
      best = 0
      travel = 0
      lost = .false.
      outcome%depth = layer%surface - s%bodies%x(3, n) + shot%radius
      outcome%overlap = 0
      outcome%duration = 0
      outcome%travel = 0
      outcome%status = 0
      outcome%steps = 0
      do while (outcome%status == 0)
         call advance(s)
         outcome%steps = outcome%steps + 1
         if (s%trouble /= sound) return
         time = outcome%steps*s%dt
         associate (x => s%bodies%x(:, n), v => s%bodies%v(:, n), f => s%bodies%f(:, n))
            travel = travel + s%dt*dot_product(v(1:2), shot%heading)
            outcome%depth = max(outcome%depth, layer%surface - x(3) + shot%radius)
            if (v(3) > best) then
               best = v(3)
               outcome%peak = state_of(s, shot)
               outcome%duration = time
               outcome%travel = travel
            end if
            if (v(3) > 0 .and. .not. lost .and. .not. any(abs(f) > 0)) then
               lost = .true.
               outcome%loss = state_of(s, shot)
            end if
            if (mod(outcome%steps, watch_interval) /= 0) cycle
            call watch_energy(s)
            outcome%overlap = max(outcome%overlap, deepest_share(s))
            if (v(3) > 0 .and. .not. any(abs(f) > 0)) then
               if (.not. will_meet(s)) then
                  outcome%status = rebounded
                  outcome%clear = state_of(s, shot)
               end if
            end if
            if (outcome%status /= 0) exit
            if (time > shot%patience*unit .or. body_energy(s%bodies, n) < nothing &
                .or. (best > 0 .and. max(0.0_wp, v(3))**2 < shot%past*best**2 &
                      .and. time > outcome%duration + shot%wait*unit)) &
               outcome%status = merge(lifted, rolled_on, lost)
         end associate
      end do
      if (.not. best > 0) outcome%peak = state_of(s, shot)
      if (outcome%status /= rebounded) outcome%clear = outcome%peak
      if (.not. lost) outcome%loss = outcome%peak
   end subroutine follow

   !> Motion of the boulder in the frame of its heading; if it is thrown back, V_t < 0 because the frame is kept.
   pure type(state_t) function state_of(s, shot) result(state)
      type(assembly_t), intent(in) :: s
      type(shot_t), intent(in) :: shot
      real(wp) :: along, across, speed, t(2)

      associate (v => s%bodies%v(:, s%bodies%n), h => shot%heading)
         along = v(1)*h(1) + v(2)*h(2)
         across = v(2)*h(1) - v(1)*h(2)
         speed = sqrt(along**2 + across**2)
         t = h
         if (speed > 0) t = sign(1.0_wp, along)*v(1:2)/speed
         state%v = [sign(speed, along), v(3), shot%radius*(v(5)*t(1) - v(4)*t(2))]
         state%lateral = 0
         if (speed > 0) state%lateral = sign(1.0_wp, along)*across/speed
      end associate
   end function state_of

   !> Return whether the boulder, or the sphere around it, would hit a body if all continued in straight lines. In free
   !> flight, gravity does not change the motion relative to flying bodies; a fall back to the layer is the next impact.
   !> Includes the periodic images next to the box.
   pure logical function will_meet(s)
      type(assembly_t), intent(in) :: s
      real(wp) :: centre(3), v(6), reach, p(3), u(3), along, square
      integer :: k, i, j

      will_meet = .true.
      associate (b => s%bodies, n => s%bodies%n)
         centre = body_position(b, n)
         centre(1:2) = centre(1:2) - s%box%width*anint((centre(1:2) - b%x(1:2, n))/s%box%width)
         v = body_velocity(b, n)
         reach = body_reach(b, n)
         do k = 1, first_sphere(b, n) - 1
            u = v(1:3) - b%v(1:3, k)
            square = dot_product(u, u)
            do j = -1, 1
               do i = -1, 1
                  p = b%x(:, k) - centre
                  p(1:2) = p(1:2) + s%box%width*[i, j]
                  along = dot_product(p, u)
                  if (along > 0 .and. dot_product(p, p)*square - along**2 &
                      < (b%radius(k) + reach)**2*square) return
               end do
            end do
         end do
      end associate
      will_meet = .false.
   end function will_meet
end module lab_impact
