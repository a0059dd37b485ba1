! SPDX-License-Identifier: BSD-3-Clause
!> Roots of covariance matrices. The kernel, the laboratory and the reference planes accept a covariance and draw from
!> it by the same rule (theory, chapter 5). If the correlations are clearly positive definite, the root is LAPACK's
!> Cholesky factor. Libraries disagree on the rank of singular matrices, so for all other matrices rotations in a fixed
!> order determine the rank and the root.
module rockfall_covariance
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite, ieee_value, ieee_quiet_nan
   use rockfall_kinds, only: wp
   use rockfall_error, only: error_t, fail, our_fault
   use rockfall_text, only: integer_text, real_text
   implicit none
   private
   public :: covariance_root, product_of, printed_tolerance

   real(wp), parameter :: symmetry_tolerance = 1.0e-12_wp  !! maximum asymmetry, as a difference of correlations [-]
   !> Minimum eigenvalue of correlations [-] above which rounding errors cannot make Cholesky's method fail.
   real(wp), parameter :: clearly_definite = 1.0e-12_wp
   !> Negative eigenvalues down to minus this come from the rounding of printed numbers [-]: six digits change a
   !> correlation by up to 1e-5, and thus an eigenvalue of a 9 x 9 matrix by up to 9e-5.
   real(wp), parameter :: printed_tolerance = 1.0e-4_wp
   real(wp), parameter :: product_tolerance = 1.0e-12_wp   !! maximum error of L L^T, as correlations [-]
   real(wp), parameter :: negligible = 1.0e-30_wp  !! off-diagonal entries up to this are not rotated away [-]
   integer, parameter :: max_sweeps = 30           !! usually 6 to 10

   interface  ! LAPACK
      pure subroutine dpotrf(uplo, n, a, lda, info)
         import :: wp
         character, intent(in) :: uplo
         integer, intent(in) :: n, lda
         real(wp), intent(inout) :: a(lda, *)
         integer, intent(out) :: info
      end subroutine dpotrf
   end interface

contains

   !> Root L of a covariance C = D R D, where D are the standard deviations and R the correlations. If R is clearly
   !> definite, L = D chol(R), and `drawn` is C itself. Otherwise R = V E V^T with negative eigenvalues set to zero, L =
   !> D V sqrt(E), and `drawn` is L L^T, the covariance of numbers drawn with L. Errors: an entry that is not finite,
   !> asymmetry, a negative variance, a covariance without variance, an indefinite matrix.
   pure subroutine covariance_root(name, c, root, drawn, error)
      character(len=*), intent(in) :: name           !! name of C, for messages
      real(wp), intent(in) :: c(:, :)                !! any [unit]
      real(wp), intent(out) :: root(:, :), drawn(:, :)
      type(error_t), allocatable, intent(out) :: error
      real(wp), dimension(size(c, 1), size(c, 1)) :: correlation, vectors, product
      real(wp), dimension(size(c, 1)) :: deviation, eigenvalue
      integer :: i, k, n
      logical :: is_definite

      n = size(c, 1)
      root = 0
      drawn = 0
      call check_entries(name, c, error)
      if (allocated(error)) return
      do i = 1, n
         deviation(i) = sqrt(c(i, i))
      end do
      do k = 1, n
         do i = k, n
            correlation(i, k) = correlation_of(c, deviation, i, k)
            correlation(k, i) = correlation(i, k)
         end do
      end do
      call check_correlations(name, c, deviation, correlation, error)
      if (allocated(error)) return
      call find_eigenvalues(correlation, eigenvalue, vectors)
      if (minval(eigenvalue) < -printed_tolerance) then
         call fail(error, name//" is indefinite: the smallest eigenvalue of its correlation matrix is " &
                   //real_text(minval(eigenvalue), 3)//" but must be >= 0")
         return
      end if
      is_definite = minval(eigenvalue) > clearly_definite
      if (is_definite) then
         root = cholesky(correlation)
      else
         do k = 1, n
            root(:, k) = vectors(:, k)*sqrt(max(0.0_wp, eigenvalue(k)))
         end do
      end if
      product = product_of(root)
      if (.not. all(abs(product - correlation) <= product_tolerance - min(0.0_wp, minval(eigenvalue)))) then
         call fail(error, "internal error: the root of the "//name//" is inaccurate", our_fault)
         return
      end if
      do k = 1, n
         drawn(:, k) = deviation*product(:, k)*deviation(k)
         root(:, k) = deviation*root(:, k)
      end do
      if (is_definite) drawn = c
   end subroutine covariance_root

   !> Lower triangular L with L L^T = R for a definite R; NaN if LAPACK fails, which the check of the product detects.
   pure function cholesky(r) result(root)
      real(wp), intent(in) :: r(:, :)  !! [-]
      real(wp) :: root(size(r, 1), size(r, 1))
      integer :: info, k

      root = r
      call dpotrf("L", size(r, 1), root, size(r, 1), info)
      if (info /= 0) root = ieee_value(1.0_wp, ieee_quiet_nan)
      do k = 2, size(r, 1)
         root(:k - 1, k) = 0
      end do
   end function cholesky

   !> Product L L^T, summed in the same order on every machine.
   pure function product_of(root) result(c)
      real(wp), intent(in) :: root(:, :)
      real(wp) :: c(size(root, 1), size(root, 1))
      integer :: i, j

      do j = 1, size(c, 2)
         do i = 1, size(c, 1)
            c(i, j) = dot_product(root(i, :), root(j, :))
         end do
      end do
   end function product_of

   !> Correlation of two entries: 1 for an entry with itself, 0 without variance.
   pure real(wp) function correlation_of(c, deviation, i, j) result(correlation)
      real(wp), intent(in) :: c(:, :), deviation(:)
      integer, intent(in) :: i, j

      correlation = 0
      if (.not. min(deviation(i), deviation(j)) > 0) return
      correlation = 1
      if (i /= j) correlation = c(i, j)/deviation(i)/deviation(j)
   end function correlation_of

   !> Check that all entries are finite, and that entries without variance have no covariance.
   pure subroutine check_entries(name, c, error)
      character(len=*), intent(in) :: name
      real(wp), intent(in) :: c(:, :)
      type(error_t), allocatable, intent(out) :: error
      integer :: i, j

      if (.not. all(ieee_is_finite(c))) then
         call fail(error, name//": entry "//place_of(findloc(ieee_is_finite(c), .false.))//" is not finite")
         return
      end if
      do j = 1, size(c, 2)
         do i = 1, size(c, 1)
            if (c(j, j) < 0) then
               call fail(error, name//": variance "//place_of([j, j])//" = "//real_text(c(j, j), 3) &
                         //" but must be >= 0")
            else if (abs(c(i, j)) > 0 .and. .not. c(j, j) > 0) then
               call fail(error, name//": entry "//place_of([max(i, j), min(i, j)])//" = "//real_text(c(i, j), 3) &
                         //" requires a variance "//place_of([j, j])//" above 0")
            end if
            if (allocated(error)) return
         end do
      end do
   end subroutine check_entries

   !> Check that a covariance is symmetric, and that no correlation is above 1.
   pure subroutine check_correlations(name, c, deviation, correlation, error)
      character(len=*), intent(in) :: name
      real(wp), intent(in) :: c(:, :), deviation(:), correlation(:, :)
      type(error_t), allocatable, intent(out) :: error
      integer :: i, j

      do j = 1, size(c, 2)
         do i = j + 1, size(c, 1)
            if (abs(c(i, j) - c(j, i)) > symmetry_tolerance*deviation(i)*deviation(j)) then
               call fail(error, name//" is not symmetric: entry "//place_of([i, j])//" = "//real_text(c(i, j), 17) &
                         //", entry "//place_of([j, i])//" = "//real_text(c(j, i), 17))
            else if (abs(correlation(i, j)) > 1 + printed_tolerance) then
               call fail(error, name//" is indefinite: entry "//place_of([i, j])//" implies a correlation of " &
                         //real_text(correlation(i, j), 6)//", which must be -1 to 1")
            end if
            if (allocated(error)) return
         end do
      end do
   end subroutine check_correlations

   pure function place_of(indices) result(text)
      integer, intent(in) :: indices(2)
      character(len=:), allocatable :: text

      text = "("//integer_text(indices(1))//", "//integer_text(indices(2))//")"
   end function place_of

   !> Eigenvalues and eigenvectors of a symmetric matrix with entries up to 1, by Jacobi rotations in a fixed order.
   pure subroutine find_eigenvalues(matrix, eigenvalue, vectors)
      real(wp), intent(in) :: matrix(:, :)
      real(wp), intent(out) :: eigenvalue(:), vectors(:, :)  !! vectors as columns
      real(wp) :: a(size(matrix, 1), size(matrix, 1)), t, c, s, ratio
      integer :: i, j, sweep
      logical :: is_diagonal

      a = matrix
      vectors = 0
      do i = 1, size(a, 1)
         vectors(i, i) = 1
      end do
      do sweep = 1, max_sweeps
         is_diagonal = .true.
         do j = 2, size(a, 1)
            do i = 1, j - 1
               if (.not. abs(a(i, j)) > negligible) cycle
               is_diagonal = .false.
               ratio = (a(j, j) - a(i, i))/(2*a(i, j))
               t = sign(1/(abs(ratio) + sqrt(1 + ratio*ratio)), ratio)
               c = 1/sqrt(1 + t*t)
               s = t*c
               call rotate(a(:, i), a(:, j), c, s)
               call rotate(a(i, :), a(j, :), c, s)
               call rotate(vectors(:, i), vectors(:, j), c, s)
               a(i, j) = 0
               a(j, i) = 0
            end do
         end do
         if (is_diagonal) exit
      end do
      do i = 1, size(a, 1)
         eigenvalue(i) = a(i, i)
      end do
   end subroutine find_eigenvalues

   pure elemental subroutine rotate(x, y, c, s)
      real(wp), intent(inout) :: x, y
      real(wp), intent(in) :: c, s  !! cosine and sine
      real(wp) :: turned

      turned = c*x - s*y
      y = s*x + c*y
      x = turned
   end subroutine rotate
end module rockfall_covariance
