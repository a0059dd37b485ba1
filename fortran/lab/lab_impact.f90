! SPDX-License-Identifier: BSD-3-Clause
!> A sphere hits a layer. It starts at its first contact, and is followed until it has left for good
!> or its energy is spent. Velocities are (V_t, V_n, W) of the trajectory kernel: V_t > 0 forward,
!> V_n > 0 away from the surface, W = R_b omega > 0 for forward rolling.
module lab_impact
   use rockfall_kinds, only: wp
   use rockfall_error, only: error_t, fail
   use rockfall_math, only: degree, sine_cosine
   use lab_contact, only: material_t
   use lab_bodies, only: bodies_t, bodies, body_energy
   use lab_packing, only: layer_t, skin_share
   use lab_step, only: assembly_t, assemble, advance, watch_energy, deepest_share, safe_step, &
      sound, leapt, step_too_long, energy_grew
   implicit none
   private
   public :: shot_t, outcome_t, film_t, fire, first_contact, check_shot
   public :: rebounded, lifted, captured, exploded, misfit

   !> How an impact ended. Only the first three are results.
   integer, parameter :: rebounded = 1  !! it left upwards, and would meet nothing on its way
   integer, parameter :: lifted = 2     !! it was thrown upwards, but slowed down within the layer
   integer, parameter :: captured = 3   !! no upward motion worth the name
   integer, parameter :: exploded = 4   !! see `trouble`; its numbers mean nothing
   integer, parameter :: misfit = 5     !! the sphere or its path does not fit the layer

   !> What is fired, and how it is followed.
   type :: shot_t
      real(wp) :: radius = 1            !! R_b [m]
      real(wp) :: density = 2650        !! [kg/m3]
      real(wp) :: speed = 15            !! [m/s]
      real(wp) :: angle = 45            !! of the path from the surface, 90 = vertical [degrees]
      real(wp) :: spin = 0              !! W/V [-]
      real(wp) :: aim = 0.5_wp          !! where the path meets the mean surface, of the width [-]
      real(wp) :: gravity = 9.81_wp     !! [m/s2]
      real(wp) :: patience = 40         !! longest duration / ((R_b + R_m)/speed)
      real(wp) :: spent = 1.0e-4_wp     !! share of the incident energy that counts as none
      real(wp) :: past = 0.5_wp !! share of its greatest upward energy left when that peak is past,
      real(wp) :: wait = 2              !! and time since the peak / ((R_b + R_m)/speed)
      real(wp) :: step_share = 1        !! step / what `safe_step` gives
      integer :: retries = 3            !! times that a step found too long is halved
   end type shot_t

   type :: outcome_t
      integer :: status = 0
      integer :: trouble = sound
      real(wp) :: incoming(3) = 0       !! (V_t, V_n, W) at the first contact [m/s]
      real(wp) :: outgoing(3) = 0       !! when its upward kinetic energy was greatest: if it
                                        !! rebounds, at the end of the last contact; 0 if it
                                        !! never moved up [m/s]
      real(wp) :: duration = 0          !! from the first contact until then [s]
      real(wp) :: travel = 0            !! along the surface, in this time [m]
      real(wp) :: depth = 0             !! deepest point of the sphere below the mean surface [m]
      real(wp) :: overlap = 0 !! deepest of two bodies / the smaller radius, as seen now and then
      integer :: halvings = 0           !! of the step
      integer :: steps = 0
   end type outcome_t

   !> Pictures at even times, up to `size(time)`.
   type :: film_t
      real(wp) :: interval = 0          !! [s]
      integer :: frames = 0             !! taken
      real(wp), allocatable :: time(:)     !! [s]
      real(wp), allocatable :: x(:, :, :)  !! (2, n + 1, frames) centres, the sphere last [m]
      real(wp), allocatable :: v(:, :, :)  !! (3, n + 1, frames) [m/s], [rad/s]
   end type film_t

   real(wp), parameter :: opening_gap = 1.0e-9_wp  !! between sphere and layer at the start / R_b
   integer, parameter :: most_retries = 30 !! the step is then 1e-9 of what it was
   integer, parameter :: watch_interval = 32 !! steps between looks at energy and at the way out

contains

   !> Fire one shot: a pure function of its arguments.
   pure subroutine fire(layer, material, shot, outcome, film)
      type(layer_t), intent(in) :: layer
      type(material_t), intent(in) :: material
      type(shot_t), intent(in) :: shot
      type(outcome_t), intent(out) :: outcome
      type(film_t), intent(inout), optional :: film
      type(assembly_t) :: s
      real(wp) :: start(2), v(3)
      integer :: k

      v = incident(shot)
      outcome%incoming = [v(1), v(2), v(3)*shot%radius]
      start = first_contact(layer, shot)
      if (.not. fits(layer, shot, start)) then
         outcome%status = misfit
         return
      end if
      do k = 0, shot%retries
         if (present(film)) film%frames = 0
         call load(layer, material, shot, start, v, 0.5_wp**k, s)
         call follow(layer, shot, s, outcome, film)
         outcome%halvings = k
         if (.not. any(s%trouble == [step_too_long, leapt, energy_grew])) exit
      end do
      outcome%trouble = s%trouble
      if (s%trouble /= sound) outcome%status = exploded
   end subroutine fire

   !> Refuse what cannot be fired.
   pure subroutine check_shot(shot, error)
      type(shot_t), intent(in) :: shot
      type(error_t), allocatable, intent(out) :: error

      if (.not. (shot%radius > 0 .and. shot%density > 0)) then
         call fail(error, "impact: radius and density must be > 0")
      else if (.not. shot%speed > 0) then
         call fail(error, "impact: speed must be > 0 [m/s]")
      else if (.not. (shot%angle >= 1 .and. shot%angle <= 90)) then
         call fail(error, "impact: angle must be 1 to 90 degrees from the surface")
      else if (.not. (abs(shot%spin) < huge(1.0_wp) .and. abs(shot%aim - 0.5_wp) <= 0.5_wp)) then
         call fail(error, "impact: spin must be a number and aim 0 to 1")
      else if (.not. min(shot%step_share, shot%patience, shot%spent) > 0) then
         call fail(error, "impact: step_share, patience and spent must be > 0")
      else if (.not. min(shot%gravity, shot%past, shot%wait, real(shot%retries, wp)) >= 0) then
         call fail(error, "impact: gravity, past, wait and retries must be >= 0")
      else if (shot%retries > most_retries) then
         call fail(error, "impact: retries must be at most 30")
      end if
   end subroutine check_shot

   !> Velocity and spin before the impact.
   pure function incident(shot) result(v)
      type(shot_t), intent(in) :: shot
      real(wp) :: v(3), s, c

      if (shot%angle <= 45) then
         call sine_cosine(shot%angle*degree, s, c)
      else
         call sine_cosine((90 - shot%angle)*degree, c, s)
      end if
      v = shot%speed*[c, -s, shot%spin/shot%radius]
   end function incident

   !> Centre of the sphere when it first touches the layer, or the floor, on its straight path.
   pure function first_contact(layer, shot) result(centre)
      type(layer_t), intent(in) :: layer
      type(shot_t), intent(in) :: shot
      real(wp) :: centre(2)
      real(wp) :: d(2), p(2), v(3), along, across, reach, way
      integer :: k, image, images

      v = incident(shot)/shot%speed
      d = v(1:2)
      p = [shot%aim*layer%box%width, layer%surface]
      way = (p(2) - shot%radius)/(-d(2))  ! to the floor, from the aim along the path
      images = 0
      if (layer%box%periodic) then
         images = 2 + int((abs(way) + (layer%top + shot%radius)/(-d(2)))/layer%box%width)
      end if
      do k = 1, size(layer%radius)
         reach = layer%radius(k) + shot%radius
         do image = -images, images
            associate (q => layer%x(:, k) + [image*layer%box%width, 0.0_wp] - p)
               along = q(1)*d(1) + q(2)*d(2)
               across = q(1)*d(2) - q(2)*d(1)
            end associate
            if (abs(across) >= reach) cycle
            way = min(way, along - sqrt((reach - across)*(reach + across)))
         end do
      end do
      centre = p + (way - opening_gap*shot%radius)*d
   end function first_contact

   !> A periodic box must be so wide that the sphere never touches two images of a body; one with
   !> sides must hold the sphere.
   pure logical function fits(layer, shot, start)
      type(layer_t), intent(in) :: layer
      type(shot_t), intent(in) :: shot
      real(wp), intent(in) :: start(2)

      if (layer%box%periodic) then
         fits = shot%radius + maxval(layer%radius) + skin_share*layer%mean_radius &
                < layer%box%width/2
      else
         fits = start(1) > shot%radius .and. start(1) < layer%box%width - shot%radius
      end if
   end function fits

   !> Layer at rest and sphere at its first contact. Bodies that it hits may fly off at twice its
   !> speed.
   pure subroutine load(layer, material, shot, start, v, fineness, s)
      type(layer_t), intent(in) :: layer
      type(material_t), intent(in) :: material
      type(shot_t), intent(in) :: shot
      real(wp), intent(in) :: start(2), v(3), fineness
      type(assembly_t), intent(out) :: s
      type(bodies_t) :: b
      real(wp) :: dt
      integer :: n

      n = size(layer%radius) + 1
      b = bodies(reshape([layer%x, start], [2, n]), [layer%radius, shot%radius], &
                 [spread(layer%density, 1, n - 1), shot%density])
      b%v(:, n) = v
      dt = min(safe_step(material, minval(b%radius(:n - 1)), layer%density, 2*shot%speed), &
               safe_step(material, shot%radius, shot%density, 2*shot%speed))
      call assemble(s, b, layer%box, material, shot%gravity, dt*shot%step_share*fineness, &
                    skin_share*layer%mean_radius, 1, body_energy(b, n))
   end subroutine load

   !> Step until the greatest upward energy is known, or nothing is left to rise.
   pure subroutine follow(layer, shot, s, outcome, film)
      type(layer_t), intent(in) :: layer
      type(shot_t), intent(in) :: shot
      type(assembly_t), intent(inout) :: s
      type(outcome_t), intent(inout) :: outcome
      type(film_t), intent(inout), optional :: film
      real(wp) :: time, time_limit, wait, past, nothing, best(3), way
      integer :: n
      logical :: still, was_still

      n = s%bodies%n
      associate (x => s%bodies%x(:, n), v => s%bodies%v(:, n))
         nothing = shot%spent*body_energy(s%bodies, n)
         time_limit = shot%patience*(shot%radius + layer%mean_radius)/shot%speed
         wait = shot%wait*(shot%radius + layer%mean_radius)/shot%speed
         time = 0
         best = 0
         way = 0
         outcome%depth = layer%surface - x(2) + shot%radius
         outcome%overlap = 0
         outcome%duration = 0
         outcome%travel = 0
         outcome%status = 0
         outcome%steps = 0
         still = .false.
         do while (outcome%status == 0)
            if (present(film)) call expose(s, time, film)
            call advance(s)
            outcome%steps = outcome%steps + 1
            if (s%trouble /= sound) return
            time = outcome%steps*s%dt
            way = way + s%dt*v(1)
            outcome%depth = max(outcome%depth, layer%surface - x(2) + shot%radius)
            if (v(2) > best(2)) then
               best = v
               outcome%duration = time
               outcome%travel = way
            end if
            if (mod(outcome%steps, watch_interval) /= 0) cycle
            call watch_energy(s)
            outcome%overlap = max(outcome%overlap, deepest_share(s))
            past = merge(shot%past, 0.0_wp, time > outcome%duration + wait)
            was_still = still  ! at two looks: at the turning point it is so at one
            still = body_energy(s%bodies, n) < nothing
            outcome%status = end_of(s, best(2), past, nothing, still .and. was_still, &
                                    time > time_limit)
         end do
      end associate
      if (present(film)) call expose(s, time, film)
      outcome%outgoing = [best(1), best(2), best(3)*shot%radius]
   end subroutine follow

   !> How the impact has ended; 0: not yet.
   pure integer function end_of(s, best, past, nothing, still, late)
      type(assembly_t), intent(in) :: s
      real(wp), intent(in) :: best     !! greatest upward speed so far [m/s]
      real(wp), intent(in) :: past     !! share of its energy left when the peak is past; 0: not yet
      real(wp), intent(in) :: nothing  !! energy that counts as none [J]
      logical, intent(in) :: still     !! its energy is spent
      logical, intent(in) :: late      !! patience has ended
      real(wp) :: up
      logical :: rises

      end_of = 0
      associate (b => s%bodies, n => s%bodies%n)
         up = max(0.0_wp, b%v(2, n))
         rises = 0.5_wp*b%mass(n)*best**2 > nothing
         if (rises .and. up > 0 .and. .not. any(abs(b%f(:, n)) > 0)) then
            if (.not. will_meet(s)) end_of = rebounded
         end if
         if (end_of /= 0) return
         if (late .or. still .or. up**2 < past*best**2) then
            if (rises) then
               end_of = lifted
            else if (late .or. still) then
               end_of = captured
            end if
         end if
      end associate
   end function end_of

   !> Would the sphere meet a body if all went on straight? In free flight gravity changes nothing
   !> relative to flying bodies; that the sphere falls back to the layer is its next impact, not
   !> this one. Looks as far as the next image on each side.
   pure logical function will_meet(s)
      type(assembly_t), intent(in) :: s
      real(wp) :: p(2), u(2), away, square
      integer :: k, image, images

      will_meet = .true.
      images = merge(1, 0, s%box%periodic)
      associate (b => s%bodies, n => s%bodies%n)
         do k = 1, n - 1
            u = b%v(1:2, n) - b%v(1:2, k)
            square = u(1)**2 + u(2)**2
            do image = -images, images
               p = b%x(:, k) + [image*s%box%width, 0.0_wp] - b%x(:, n)
               away = p(1)*u(2) - p(2)*u(1)
               if (p(1)*u(1) + p(2)*u(2) > 0 &
                  .and. away**2 < (b%radius(k) + b%radius(n))**2*square) return
            end do
         end do
      end associate
      will_meet = .false.
   end function will_meet

   !> Take a picture when one is due.
   pure subroutine expose(s, time, film)
      type(assembly_t), intent(in) :: s
      real(wp), intent(in) :: time
      type(film_t), intent(inout) :: film

      if (film%frames == size(film%time)) return
      if (time < film%frames*film%interval) return
      film%frames = film%frames + 1
      film%time(film%frames) = time
      film%x(:, :, film%frames) = s%bodies%x
      film%v(:, :, film%frames) = s%bodies%v
   end subroutine expose
end module lab_impact
