! SPDX-License-Identifier: BSD-3-Clause
!> Roots of covariances: the product is the covariance, or the nearest semidefinite matrix (also by LAPACK's
!> eigenvalues); units do not matter; invalid covariances are refused with a message.
program test_covariance
   use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan, ieee_positive_inf
   use rockfall_kinds, only: wp
   use rockfall_error, only: error_t, bad_input
   use rockfall_covariance, only: covariance_root, product_of, printed_tolerance
   use check_m, only: check, finish
   implicit none

   integer, parameter :: n = 9
   interface  ! LAPACK
      subroutine dpotrf(uplo, n, a, lda, info)
         import :: wp
         character, intent(in) :: uplo
         integer, intent(in) :: n, lda
         real(wp), intent(inout) :: a(lda, *)
         integer, intent(out) :: info
      end subroutine dpotrf
      subroutine dsyev(jobz, uplo, n, a, lda, w, work, lwork, info)
         import :: wp
         character, intent(in) :: jobz, uplo
         integer, intent(in) :: n, lda, lwork
         real(wp), intent(inout) :: a(lda, *)
         real(wp), intent(out) :: w(n), work(lwork)
         integer, intent(out) :: info
      end subroutine dsyev
   end interface
   integer :: rank, k, exponent

   call random_init(.true., .false.)
   do k = 1, 50
      do rank = 1, n
         call test_root("as computed", of_rank(rank))
         call test_root("six digits", printed(of_rank(rank), 6))
         call test_root("seven digits", printed(of_rank(rank), 7))
         call test_root("deviations of 1e-5 to 1", scaled(of_rank(rank), 5))
         call test_root("printed deviations of 1e-8 to 1", printed(scaled(of_rank(rank), 8), 6))
         call test_units(of_rank(rank))
         call test_units(printed(of_rank(rank), 6))
      end do
   end do
   do exponent = -290, 290, 20
      call test_root("any size", 10.0_wp**exponent*of_rank(4))
   end do
   call test_definite()
   call test_special()
   call test_refused()
   call finish()

contains

   !> Covariance of a given rank, with standard deviations of 0.01 to 0.5.
   function of_rank(rank) result(c)
      integer, intent(in) :: rank
      real(wp) :: c(n, n), b(n, rank), deviation(n)
      integer :: i

      call random_number(b)
      call random_number(deviation)
      do i = 1, n
         b(i, :) = (2*b(i, :) - 1)
         b(i, :) = b(i, :)*(0.01_wp + 0.49_wp*deviation(i))/norm2(b(i, :))
      end do
      c = product_of(b)
   end function of_rank

   !> Numbers rounded to a number of digits.
   function printed(c, digits) result(short)
      real(wp), intent(in) :: c(n, n)
      integer, intent(in) :: digits
      real(wp) :: short(n, n)
      character(len=40) :: form, text
      integer :: i, j

      write (form, "(a,i0,a)") "(es30.", digits - 1, "e3)"
      do j = 1, n
         do i = 1, n
            write (text, form) c(i, j)
            read (text, *) short(i, j)
         end do
      end do
   end function printed

   !> Covariance whose standard deviations are multiplied by 1, 0.1, ..., 10**(-decades) in turn.
   pure function scaled(c, decades) result(other)
      real(wp), intent(in) :: c(n, n)
      integer, intent(in) :: decades
      real(wp) :: other(n, n)
      integer :: i, j

      do j = 1, n
         do i = 1, n
            other(i, j) = c(i, j)*10.0_wp**(-mod(i, decades + 1) - mod(j, decades + 1))
         end do
      end do
   end function scaled

   pure function correlations(c) result(r)
      real(wp), intent(in) :: c(n, n)
      real(wp) :: r(n, n)
      integer :: i, j

      do j = 1, n
         do i = 1, n
            r(i, j) = c(i, j)/sqrt(c(i, i))/sqrt(c(j, j))
         end do
      end do
   end function correlations

   !> Eigenvalues of correlations, and the nearest semidefinite matrix, by LAPACK.
   subroutine nearest_by_lapack(r, eigenvalue, nearest)
      real(wp), intent(in) :: r(n, n)
      real(wp), intent(out) :: eigenvalue(n), nearest(n, n)
      real(wp) :: vectors(n, n), work(200)
      integer :: info, k

      vectors = r
      call dsyev("V", "L", n, vectors, n, eigenvalue, work, size(work), info)
      call check("LAPACK has eigenvalues", info == 0)
      nearest = 0
      do k = 1, n
         nearest = nearest + max(0.0_wp, eigenvalue(k))*spread(vectors(:, k), 2, n)*spread(vectors(:, k), 1, n)
      end do
   end subroutine nearest_by_lapack

   !> Check the root of a covariance that may be singular, or indefinite by rounding.
   subroutine test_root(name, c)
      character(len=*), intent(in) :: name
      real(wp), intent(in) :: c(n, n)
      real(wp), dimension(n, n) :: root, drawn, nearest, product
      real(wp) :: eigenvalue(n), deviation(n)
      type(error_t), allocatable :: error
      integer :: i

      call covariance_root("covariance", c, root, drawn, error)
      call check(name//": accepted", .not. allocated(error))
      if (allocated(error)) return
      call nearest_by_lapack(correlations(c), eigenvalue, nearest)
      do i = 1, n
         deviation(i) = sqrt(c(i, i))
      end do
      product = product_of(root/spread(deviation, 2, n))
      call check(name//": the nearest semidefinite correlations", maxval(abs(product - nearest)) <= 1.0e-12_wp)
      product = drawn/spread(deviation, 2, n)/spread(deviation, 1, n)
      call check(name//": drawn from the nearest, too", maxval(abs(product - nearest)) <= 1.0e-12_wp)
      call check(name//": as far from the set as its eigenvalue", &
                 maxval(abs(product - correlations(c))) <= 1.0e-12_wp - min(0.0_wp, eigenvalue(1)))
      do i = 1, n
         call check(name//": variances", abs(drawn(i, i)/c(i, i) - 1) <= 1.0e-12_wp - min(0.0_wp, eigenvalue(1)))
      end do
   end subroutine test_root

   !> Changing units by powers of two scales the root exactly.
   subroutine test_units(c)
      real(wp), intent(in) :: c(n, n)
      real(wp), parameter :: unit(n) = 2.0_wp**[0, -30, 7, 40, -3, 0, 1, -60, 25]
      real(wp), dimension(n, n) :: root, drawn, other_root, other
      type(error_t), allocatable :: error
      integer :: i

      call covariance_root("covariance", c, root, drawn, error)
      call covariance_root("covariance", c*spread(unit, 1, n)*spread(unit, 2, n), other_root, other, error)
      call check("other units are accepted", .not. allocated(error))
      do i = 1, n
         call check("root in other units", all(abs(other_root(i, :) - unit(i)*root(i, :)) <= 0))
         call check("drawn in other units", all(abs(other(i, :) - unit(i)*unit*drawn(i, :)) <= 0))
      end do
   end subroutine test_units

   !> A clearly definite covariance is used unchanged, and its root gives the same product as LAPACK's Cholesky factor.
   subroutine test_definite()
      real(wp), dimension(n, n) :: c, root, drawn, factor
      type(error_t), allocatable :: error
      integer :: k, i, info

      do k = 1, 100
         c = of_rank(n)
         do i = 1, n
            c(i, i) = c(i, i)*(1 + 10.0_wp**(-mod(k, 8)))
         end do
         call covariance_root("covariance", c, root, drawn, error)
         call check("definite: drawn as given", all(abs(drawn - c) <= 0) .and. .not. allocated(error))
         factor = c
         call dpotrf("L", n, factor, n, info)
         do i = 2, n
            factor(:i - 1, i) = 0
         end do
         call check("definite: the product of LAPACK's factor", &
                    info == 0 .and. maxval(abs(product_of(root) - product_of(factor))) <= 1.0e-14_wp)
      end do
   end subroutine test_definite

   subroutine test_special()
      real(wp), dimension(n, n) :: c, root, drawn
      type(error_t), allocatable :: error
      integer :: i

      c = 0
      call covariance_root("covariance", c, root, drawn, error)
      call check("nothing scatters", .not. allocated(error) .and. all(abs(root) <= 0) .and. all(abs(drawn) <= 0))
      c = of_rank(n)
      c(4, :) = 0
      c(:, 4) = 0
      call covariance_root("covariance", c, root, drawn, error)
      call check("an entry without scatter has none", .not. allocated(error) .and. all(abs(drawn(:, 4)) <= 0) &
                 .and. all(abs(root(4, :)) <= 0))
      call check("and the others theirs", maxval(abs(drawn - c)) <= 1.0e-15_wp)
      c = 0
      do i = 1, n
         c(i, i) = 10.0_wp**(-3*i)
      end do
      call covariance_root("covariance", c, root, drawn, error)
      call check("independent entries of any size", all(abs(drawn - c) <= 0) .and. .not. allocated(error))
      c = 0.25_wp
      call covariance_root("covariance", c, root, drawn, error)
      call check("all alike", maxval(abs(product_of(root) - c)) <= 1.0e-15_wp .and. .not. allocated(error))
      c(2, :) = -c(2, :)
      c(:, 2) = -c(:, 2)
      call covariance_root("covariance", c, root, drawn, error)
      call check("one opposite", maxval(abs(product_of(root) - c)) <= 1.0e-15_wp .and. .not. allocated(error))
   end subroutine test_special

   subroutine test_refused()
      real(wp) :: c(n, n)

      c = of_rank(n)
      c(7, 2) = 0.5_wp*c(7, 2)
      call refuses("not symmetric", c, "not symmetric: entry (7, 2)")
      c = scaled(of_rank(n), 8)
      c(9, 8) = 1.001_wp*c(9, 8)
      call refuses("not symmetric among small entries", c, "not symmetric: entry (9, 8)")
      c = of_rank(n)
      call correlate(c, 7, 2, 1.01_wp)
      call refuses("a correlation above 1", c, "entry (7, 2) implies a correlation of 1.01")
      c = scaled(of_rank(n), 8)
      call correlate(c, 9, 8, -1.001_wp)
      call refuses("the same among small entries", c, "entry (9, 8) implies a correlation of -1.001")
      c = 0
      c(1, 1) = 1.0e-2_wp
      c(7, 7) = 1.0e-16_wp
      c(8, 7) = 9.0e-9_wp
      c(7, 8) = 9.0e-9_wp
      call refuses("a covariance without variance", c, "entry (8, 7) = 9e-9 requires a variance (8, 8) above 0")
      c(8, 8) = 1.0e-6_wp
      call refuses("more than the variances allow", c, "entry (8, 7) implies a correlation of 900")
      c = 0
      c(3, 3) = -1.0e-3_wp
      call refuses("a negative variance", c, "variance (3, 3) = -0.001 but must be >= 0")
      c = of_rank(n)
      c(9, 9) = -1.0e-12_wp
      call refuses("a small negative variance", c, "variance (9, 9) = -1e-12 but must be >= 0")
      c = three(-0.5_wp - 1.0e-3_wp)
      call refuses("three entries against each other", c, "smallest eigenvalue of its correlation matrix is -0.002")
      c = scaled(three(-0.5_wp - 1.0e-3_wp), 8)
      call refuses("the same in other units", c, "smallest eigenvalue of its correlation matrix is -0.002")
      c = printed(scaled(three(-0.5_wp - printed_tolerance), 8), 6)
      call refuses("beyond six digits", c, "smallest eigenvalue of its correlation matrix is -0.0002")
      call test_root("within six digits", three(-0.5_wp - 0.4_wp*printed_tolerance))
      c = of_rank(n)
      c(5, 5) = ieee_value(1.0_wp, ieee_quiet_nan)
      call refuses("no number", c, "entry (5, 5) is not finite")
      c = of_rank(n)
      c(6, 5) = ieee_value(1.0_wp, ieee_positive_inf)
      c(5, 6) = c(6, 5)
      call refuses("infinite", c, "entry (6, 5) is not finite")
   end subroutine test_refused

   pure subroutine correlate(c, i, j, correlation)
      real(wp), intent(inout) :: c(n, n)
      integer, intent(in) :: i, j
      real(wp), intent(in) :: correlation

      c(i, j) = correlation*sqrt(c(i, i)*c(j, j))
      c(j, i) = c(i, j)
   end subroutine correlate

   !> Correlation r between the last three entries only: the smallest eigenvalue is 1 + 2 r, negative for r < -0.5.
   pure function three(r) result(c)
      real(wp), intent(in) :: r
      real(wp) :: c(n, n)
      integer :: i

      c = 0
      c(n - 2:, n - 2:) = r
      do i = 1, n
         c(i, i) = 1
      end do
   end function three

   subroutine refuses(name, c, said)
      character(len=*), intent(in) :: name, said
      real(wp), intent(in) :: c(n, n)
      real(wp), dimension(n, n) :: root, drawn
      type(error_t), allocatable :: error

      call covariance_root("noise", c, root, drawn, error)
      call check(name//" is refused", allocated(error))
      if (.not. allocated(error)) return
      call check(name//": '"//error%message//"' names it", &
                 index(error%message, "noise") == 1 .and. index(error%message, said) > 0)
      call check(name//" is bad input", error%code == bad_input)
   end subroutine refuses
end program test_covariance
