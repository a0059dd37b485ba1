! SPDX-License-Identifier: BSD-3-Clause
!> Rotation of a rigid body: orientation as a unit quaternion, free motion by Euler's equations.
module lab_rotation
   use rockfall_kinds, only: wp, i8
   use rockfall_random, only: random_key_t, random_words, uniform
   implicit none
   private
   public :: rotation_matrix, rotate_free, any_orientation, product_of, conjugate

contains

   !> Rotation matrix; columns are the body's axes in space.
   pure function rotation_matrix(q) result(m)
      real(wp), intent(in) :: q(4)  !! (scalar, vector), unit [-]
      real(wp) :: m(3, 3)

      m(:, 1) = [1 - 2*(q(3)**2 + q(4)**2), 2*(q(2)*q(3) + q(1)*q(4)), 2*(q(2)*q(4) - q(1)*q(3))]
      m(:, 2) = [2*(q(2)*q(3) - q(1)*q(4)), 1 - 2*(q(2)**2 + q(4)**2), 2*(q(3)*q(4) + q(1)*q(2))]
      m(:, 3) = [2*(q(2)*q(4) + q(1)*q(3)), 2*(q(3)*q(4) - q(1)*q(2)), 1 - 2*(q(2)**2 + q(3)**2)]
   end function rotation_matrix

   !> Product of rotations as quaternions: `second`, then `first`.
   pure function product_of(first, second) result(q)
      real(wp), intent(in) :: first(4), second(4)  !! (scalar, vector) [-]
      real(wp) :: q(4)

      associate (a => first, b => second)
         q = [a(1)*b(1) - dot_product(a(2:), b(2:)), &
              a(1)*b(2:) + b(1)*a(2:) + [a(3)*b(4) - a(4)*b(3), a(4)*b(2) - a(2)*b(4), a(2)*b(3) - a(3)*b(2)]]
      end associate
   end function product_of

   !> Inverse rotation.
   pure function conjugate(q) result(opposite)
      real(wp), intent(in) :: q(4)  !! (scalar, vector) [-]
      real(wp) :: opposite(4)

      opposite = [q(1), -q(2:)]
   end function conjugate

   !> Uniform random orientation: the direction of a uniform point in a four-dimensional ball.
   pure function any_orientation(key, purpose, number, event) result(q)
      type(random_key_t), intent(in) :: key
      integer(i8), intent(in) :: purpose, number, event
      real(wp) :: q(4), square
      integer(i8) :: draw

      draw = 0
      do
         q = 2*uniform(random_words(key, purpose, number, event, draw)) - 1
         square = sum(q**2)
         if (square <= 1 .and. square > 0) exit
         draw = draw + 1
      end do
      q = q/sqrt(square)
   end function any_orientation

   !> Rotate freely over a time by five rotations about principal axes (Dullweber, Leimkuhler, McLachlan 1997).
   !> Conserves the angular momentum in space to rounding; the energy error stays bounded.
   pure subroutine rotate_free(q, momentum, inertia, dt)
      real(wp), intent(inout) :: q(4), momentum(3)  !! [-], in the body's axes [kg m2/s]
      real(wp), intent(in) :: inertia(3), dt        !! principal moments [kg m2], [s]

      call turn(q, momentum, inertia, 1, 2, 3, 0.5_wp*dt)
      call turn(q, momentum, inertia, 2, 3, 1, 0.5_wp*dt)
      call turn(q, momentum, inertia, 3, 1, 2, dt)
      call turn(q, momentum, inertia, 2, 3, 1, 0.5_wp*dt)
      call turn(q, momentum, inertia, 1, 2, 3, 0.5_wp*dt)
      q = q/sqrt(sum(q**2))
   end subroutine rotate_free

   !> Rotate about body axis i; j and k are the other two axes in cyclic order. The tangent of the half angle is
   !> approximated by the half angle: a third-order error in the step, like that of the splitting.
   pure subroutine turn(q, momentum, inertia, i, j, k, dt)
      real(wp), intent(inout) :: q(4), momentum(3)  !! [-], in the body's axes [kg m2/s]
      real(wp), intent(in) :: inertia(3), dt        !! [kg m2], [s]
      integer, intent(in) :: i, j, k
      real(wp) :: t, c, s, m, p(4)

      t = 0.5_wp*dt*momentum(i)/inertia(i)
      c = (1 - t*t)/(1 + t*t)
      s = 2*t/(1 + t*t)
      m = momentum(j)
      momentum(j) = c*m + s*momentum(k)
      momentum(k) = c*momentum(k) - s*m
      p = q
      q(1) = p(1) - t*p(1 + i)
      q(1 + i) = p(1 + i) + t*p(1)
      q(1 + j) = p(1 + j) + t*p(1 + k)
      q(1 + k) = p(1 + k) - t*p(1 + j)
      q = q/sqrt(1 + t*t)
   end subroutine turn
end module lab_rotation
