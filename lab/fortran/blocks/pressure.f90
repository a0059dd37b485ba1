! SPDX-License-Identifier: BSD-3-Clause
!> Forces of the ground on the submerged part of a flat facet: pressure up to the yield pressure, elastic unloading, and
!> Coulomb friction with memory.
module lab_pressure
   use rockfall_kinds, only: wp
   use lab_contact, only: cross
   implicit none
   private
   public :: law_t, memory_t, facet_t, part_t, submerged_part, press, untouched

   !> Parameters of the ground, derived for a block.
   type :: law_t
      real(wp) :: stiffness = 0      !! k [Pa/m]
      real(wp) :: reserve = 0        !! p_y/k: elastic depth up to yielding [m]
      real(wp) :: friction = 0       !! mu [-]
      real(wp) :: soil_density = 0   !! [kg/m3]
      logical :: plough = .false.    !! true: pressure acts along the facet's normal; false: along the ground's
   end type law_t

   !> State of a facet while any part of it is submerged.
   type :: memory_t
      real(wp) :: reserve = 0        !! remaining elastic depth e: the pressure is at most k e [m]
      real(wp) :: area = 0           !! last contact area [m2]
      real(wp) :: drag(3) = 0        !! tangential force [N]
   end type memory_t

   !> Facet and the ground below it at an instant.
   type :: facet_t
      real(wp) :: x(3, 3) = 0        !! corners relative to the centre of mass [m]
      real(wp) :: depth(3) = 0       !! depth of the corners along the ground's normal; < 0 above it [m]
      real(wp) :: normal(3) = 0      !! outward unit normal [-]
      real(wp) :: ground(3) = 0      !! unit normal of the ground [-]
      real(wp) :: area = 0           !! [m2]
   end type facet_t

   !> Integrals of the depth below a level, over the part of a facet below this level.
   type :: part_t
      real(wp) :: area = 0           !! area of this part [m2]
      real(wp) :: volume = 0         !! integral of depth [m3]
      real(wp) :: place(3) = 0       !! integral of position [m3]
      real(wp) :: moment(3) = 0      !! integral of depth times position [m4]
   end type part_t

   real(wp), parameter :: shear = 0.8_wp       !! tangential stiffness over k
   real(wp), parameter :: upright = 0.4_wp     !! pressure on an upright ploughing facet, relative to a flat facet [-]

contains

   !> State of a facet that has not touched the ground. When ploughing, e starts at zero and grows as the facet
   !> advances. On hard ground it starts at p_y/k, and the pressure depends only on the depth.
   pure type(memory_t) function untouched(law)
      type(law_t), intent(in) :: law

      untouched = memory_t(reserve=merge(0.0_wp, law%reserve, law%plough))
   end function untouched

   !> Part of a triangle below a level; the depth is linear on the triangle.
   pure type(part_t) function submerged_part(x, depth, area, level) result(part)
      real(wp), intent(in) :: x(3, 3)          !! corners [m]
      real(wp), intent(in) :: depth(3), level  !! depths of the corners; the level [m]
      real(wp), intent(in) :: area             !! area of the triangle [m2]
      type(part_t) :: dry
      real(wp) :: f(3)
      integer :: deep

      f = depth - level
      deep = count(f > 0)
      select case (deep)
      case (3)
         part = of_triangle(x, f, area)
      case (2)  ! all except the corner above the level
         part = of_triangle(x, f, area)
         dry = corner_part(x, f, area, minloc(f, 1))
         part = part_t(part%area - dry%area, part%volume - dry%volume, part%place - dry%place, &
                       part%moment - dry%moment)
      case (1)
         part = corner_part(x, f, area, maxloc(f, 1))
      end select
   end function submerged_part

   !> Part of a triangle at corner `i`, cut off where the depth is 0.
   pure type(part_t) function corner_part(x, f, area, i) result(part)
      real(wp), intent(in) :: x(3, 3), f(3), area  !! corners [m], their depths [m]; area [m2]
      integer, intent(in) :: i
      real(wp) :: y(3, 3), t, u
      integer :: j, k

      j = mod(i, 3) + 1
      k = mod(j, 3) + 1
      t = f(i)/(f(i) - f(j))
      u = f(i)/(f(i) - f(k))
      y(:, 1) = x(:, i)
      y(:, 2) = x(:, i) + t*(x(:, j) - x(:, i))
      y(:, 3) = x(:, i) + u*(x(:, k) - x(:, i))
      part = of_triangle(y, [f(i), 0.0_wp, 0.0_wp], area*t*u)
   end function corner_part

   !> Integrals of a linear depth, which may be negative, over a complete triangle.
   pure type(part_t) function of_triangle(x, f, area) result(part)
      real(wp), intent(in) :: x(3, 3), f(3), area  !! corners [m], their depths [m]; area [m2]
      real(wp) :: s

      s = f(1) + f(2) + f(3)
      part%area = area
      part%volume = area*s/3
      part%place = area/3*(x(:, 1) + x(:, 2) + x(:, 3))
      part%moment = area/12*((s + f(1))*x(:, 1) + (s + f(2))*x(:, 2) + (s + f(3))*x(:, 3))
   end function of_triangle

   !> Force and torque on a facet after a step in which the block moved with velocity and spin. The resistance of
   !> displaced ground and the friction act at the centre of the submerged part.
   pure subroutine press(law, facet, velocity, spin, dt, memory, force, torque)
      type(law_t), intent(in) :: law
      type(facet_t), intent(in) :: facet
      real(wp), intent(in) :: velocity(3), spin(3), dt  !! motion of the block [m/s], [rad/s]; step [s]
      type(memory_t), intent(inout) :: memory
      real(wp), intent(out) :: force(3), torque(3)      !! force [N]; torque about the centre of mass [N m]
      type(part_t) :: wet
      real(wp) :: facing, area, push, lever(3), place(3), along(3), at(3), inertial

      force = 0
      torque = 0
      facing = -dot_product(facet%normal, facet%ground)
      if (facing > 0) wet = submerged_part(facet%x, facet%depth, facet%area, 0.0_wp)
      if (.not. wet%area > 0) then
         memory = untouched(law)
         return
      end if
      place = wet%place/wet%area
      if (law%plough) then
         along = -facet%normal
         area = (upright + (1 - upright)*facing)*wet%area
         call plough(law, area, -dt*dot_product(velocity + cross(spin, place), along), memory, push)
         lever = push*place
      else
         along = facet%ground
         area = facing*wet%area
         call sink(law, facet, wet, velocity, spin, dt, memory, push, lever)
         push = facing*push
         lever = facing*lever
      end if
      at = velocity + cross(spin, place)
      inertial = law%soil_density*area*max(0.0_wp, -dot_product(at, along))**2
      push = push + inertial
      lever = lever + inertial*place
      call rub(law, at - dot_product(at, along)*along, along, area, push, dt, memory)
      memory%area = area
      force = push*along + memory%drag
      torque = cross(lever, along) + cross(place, memory%drag)
   end subroutine press

   !> Hard ground: pressure p = k min(d, e) along the ground's normal, with the depth d. Where d < e the ground is a
   !> spring. Where d > e it has yielded: e decreases as this part of the facet retreats, and recovers as it advances,
   !> up to p_y/k. The stored energy, k/2 times the integral of min(d, e)**2, changes exactly by the work of the
   !> pressure.
   pure subroutine sink(law, facet, wet, velocity, spin, dt, memory, push, lever)
      type(law_t), intent(in) :: law
      type(facet_t), intent(in) :: facet
      type(part_t), intent(in) :: wet                    !! submerged part
      real(wp), intent(in) :: velocity(3), spin(3), dt   !! [m/s], [rad/s], [s]
      type(memory_t), intent(inout) :: memory
      real(wp), intent(out) :: push, lever(3)  !! integrals of pressure, pressure times position [N], [N m]
      type(part_t) :: yielded
      real(wp) :: change, volume

      change = 0
      if (any(facet%depth > memory%reserve)) then
         yielded = submerged_part(facet%x, facet%depth, facet%area, memory%reserve)
         if (yielded%area > 0) then
            change = -dt*dot_product(velocity + cross(spin, yielded%place/yielded%area), facet%ground)
            change = min(max(change, -memory%reserve), law%reserve - memory%reserve)
            memory%reserve = memory%reserve + change
         end if
      end if
      push = 0
      lever = 0
      volume = wet%volume - yielded%volume + change*yielded%area
      if (.not. volume > 0) return
      push = law%stiffness*volume
      lever = law%stiffness*(wet%moment - yielded%moment + change*yielded%place)
   end subroutine sink

   !> Soft ground: pressure p = k e along the facet's normal on its submerged part, where e is its advance, at most
   !> p_y/k. Newly submerged parts take over some of the existing force, and emerging parts remove theirs: neither adds
   !> to the stored energy.
   pure subroutine plough(law, area, advance, memory, push)
      type(law_t), intent(in) :: law
      real(wp), intent(in) :: area, advance  !! submerged area by attitude [m2]; advance along the normal [m]
      type(memory_t), intent(inout) :: memory
      real(wp), intent(out) :: push          !! force along the normal [N]

      if (area > memory%area) memory%reserve = memory%reserve*memory%area/area
      memory%reserve = min(max(memory%reserve + advance, 0.0_wp), law%reserve)
      push = law%stiffness*memory%reserve*area
   end subroutine plough

   !> Coulomb friction with memory: a tangential spring, limited to mu times the push.
   pure subroutine rub(law, slip, along, area, push, dt, memory)
      type(law_t), intent(in) :: law
      real(wp), intent(in) :: slip(3), along(3)  !! velocity in the plane [m/s], unit normal of the plane [-]
      real(wp), intent(in) :: area, push, dt     !! submerged area [m2], normal force [N], step [s]
      type(memory_t), intent(inout) :: memory
      real(wp) :: square, max_friction

      associate (t => memory%drag)
         if (area < memory%area) t = t*(area/memory%area)
         t = t - dot_product(t, along)*along - (shear*law%stiffness*area*dt)*slip
         max_friction = law%friction*push
         square = dot_product(t, t)
         if (square > max_friction**2) t = t*(max_friction/sqrt(square))
      end associate
   end subroutine rub
end module lab_pressure
