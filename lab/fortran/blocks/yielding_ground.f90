! SPDX-License-Identifier: BSD-3-Clause
!> Yielding ground: its strength, and its relief as a periodic patch of heights.
module lab_yielding_ground
   use rockfall_kinds, only: wp
   use rockfall_error, only: error_t, fail
   implicit none
   private
   public :: ground_t, relief_t, make_relief, check_ground, stiffness_of, look_up

   !> Mechanical properties of the ground.
   type :: ground_t
      real(wp) :: yield_pressure = 1.0e6_wp  !! p_y [Pa]
      real(wp) :: restitution = 0.2_wp       !! restitution of a sphere of equal size that falls vertically at 5 m/s [-]
      real(wp) :: friction = 0.5_wp          !! Coulomb coefficient mu, block on ground [-]
      real(wp) :: soil_density = 1800.0_wp   !! density of soil that a block must displace; 0: none [kg/m3]
      logical :: plough = .true.             !! pressure acts along the facet's normal; false: along the ground's
   end type ground_t

   !> Heights at the centres of square cells of a periodic patch, as a biquadratic B-spline with continuous slope.
   type :: relief_t
      integer :: cells = 1                   !! number of cells along each side, a power of 2
      real(wp) :: cell = 1                   !! cell size [m]
      real(wp), allocatable :: height(:, :)  !! (0:cells - 1, 0:cells - 1) spline coefficients, mean 0 [m]
      real(wp) :: top = 0                    !! upper bound of the height [m]
      real(wp) :: steepest = 0               !! upper bound of the slope, tangent [-]
   end type relief_t

   real(wp), parameter :: reference_speed = 5  !! speed at which `restitution` applies [m/s]

contains

   pure subroutine check_ground(ground, error)
      type(ground_t), intent(in) :: ground
      type(error_t), allocatable, intent(out) :: error

      if (.not. (ground%yield_pressure >= 1.0e3_wp .and. ground%yield_pressure <= 1.0e12_wp)) then
         call fail(error, "ground: yield_pressure must be 1e3 to 1e12 [Pa]")
      else if (.not. (ground%restitution >= 0.01_wp .and. ground%restitution <= 1)) then
         call fail(error, "ground: restitution must be 0.01 to 1")
      else if (.not. (ground%friction >= 0 .and. ground%friction <= 5)) then
         call fail(error, "ground: friction must be 0 to 5")
      else if (.not. (ground%soil_density >= 0 .and. ground%soil_density <= 5000)) then
         call fail(error, "ground: soil_density must be 0 to 5000 [kg/m3]")
      end if
   end subroutine check_ground

   !> Stiffness of the foundation [Pa/m] that gives a sphere of radius R_b its `restitution` in a vertical impact at 5
   !> m/s, if its entire contact area yields.
   pure real(wp) function stiffness_of(ground, radius, density) result(k)
      type(ground_t), intent(in) :: ground
      real(wp), intent(in) :: radius, density  !! radius [m] and density [kg/m3] of the block
      real(wp) :: s

      s = density*reference_speed**2/(2*ground%yield_pressure)
      k = ground%yield_pressure/(radius*ground%restitution**2)*sqrt(0.75_wp/s)
   end function stiffness_of

   !> Build the relief from heights (cells, cells) on a patch of a given width.
   pure subroutine make_relief(height, width, relief, error)
      real(wp), intent(in) :: height(:, :)  !! [m]
      real(wp), intent(in) :: width         !! [m]
      type(relief_t), intent(out) :: relief
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: rise(2)

      relief%cells = size(height, 1)
      if (popcnt(relief%cells) /= 1 .or. size(height, 2) /= relief%cells) then
         call fail(error, "relief: a patch must be square, its cells a power of 2")
         return
      else if (.not. (width > 0 .and. maxval(abs(height)) <= 1.0e6_wp)) then
         call fail(error, "relief: width must be > 0 and heights be numbers below 1e6 m")
         return
      end if
      relief%cell = width/relief%cells
      allocate (relief%height(0:relief%cells - 1, 0:relief%cells - 1))
      relief%height = height
      relief%top = maxval(height)
      ! the slope of the spline is bounded by the slopes of its coefficients
      rise = [maxval(abs(height - cshift(height, 1, 1))), maxval(abs(height - cshift(height, 1, 2)))]
      relief%steepest = sqrt(sum(rise**2))/relief%cell
   end subroutine make_relief

   !> Height and slope at a point.
   pure subroutine look_up(relief, x, y, height, slope_x, slope_y)
      type(relief_t), intent(in) :: relief
      real(wp), intent(in) :: x, y                          !! [m]
      real(wp), intent(out) :: height, slope_x, slope_y     !! [m], [-], [-]
      real(wp) :: u, w, a(3), da(3), row(3), across(3)
      integer :: i(3), j(3), k, last

      last = relief%cells - 1
      u = x/relief%cell
      w = y/relief%cell
      k = floor(u)
      i = iand([k - 1, k, k + 1], last)
      u = u - k
      k = floor(w)
      j = iand([k - 1, k, k + 1], last)
      w = w - k
      a = [0.5_wp*(1 - u)**2, 0.5_wp + u*(1 - u), 0.5_wp*u**2]
      da = [u - 1, 1 - 2*u, u]
      do k = 1, 3
         associate (h => relief%height)
            row(k) = a(1)*h(i(1), j(k)) + a(2)*h(i(2), j(k)) + a(3)*h(i(3), j(k))
            across(k) = da(1)*h(i(1), j(k)) + da(2)*h(i(2), j(k)) + da(3)*h(i(3), j(k))
         end associate
      end do
      a = [0.5_wp*(1 - w)**2, 0.5_wp + w*(1 - w), 0.5_wp*w**2]
      height = a(1)*row(1) + a(2)*row(2) + a(3)*row(3)
      slope_x = (a(1)*across(1) + a(2)*across(2) + a(3)*across(3))/relief%cell
      slope_y = ((w - 1)*row(1) + (1 - 2*w)*row(2) + w*row(3))/relief%cell
   end subroutine look_up
end module lab_yielding_ground
