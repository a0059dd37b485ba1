! SPDX-License-Identifier: BSD-3-Clause
!> Names and order of the numbers of the block laboratory in the Python interface.
module lab_block_tables
   use rockfall_kinds, only: wp
   use rockfall_error, only: error_t, fail
   use lab_yielding_ground, only: ground_t
   implicit none
   private
   public :: ground_of, ground_row
   public :: plan_t, plan_of, plan_row, check_plan, plan_keys
   public :: ground_keys

   !> Parameters of blocks, relief and time step, used by other modules.
   type :: plan_t
      real(wp) :: radius = 0.4_wp        !! R_b of all blocks [m]
      real(wp) :: density = 2700         !! [kg/m3]
      integer :: count = 64              !! number of random blocks with this shape
      real(wp) :: edge = 1               !! longest edge of a facet, over R_b
      real(wp) :: relief = 13.5_wp       !! standard deviation of the slope along a line [degrees]
      real(wp) :: shortest = 2           !! shortest wavelength, over R_b
      real(wp) :: longest = 16           !! longest wavelength, over R_b
      real(wp) :: hurst = 0.8_wp         !! Hurst exponent between these wavelengths
      integer :: patches = 4             !! number of patches of relief
      real(wp) :: step_factor = 1        !! time step relative to the default
      real(wp) :: rest_angle = 38        !! maximum slope on which boulders using the table rest [degrees]
      real(wp) :: yield_exponent = 0     !! exponent of R_b in the yield pressure: 0 cohesive, 1 cohesionless
      real(wp) :: fitted_radius = 0.4_wp !! R_b to which relief and yield pressure apply [m]
   end type plan_t

   integer, parameter :: long = 16
   character(len=long), parameter :: plan_keys(13) = [character(len=long) :: &
      "radius", "density", "count", "edge", "relief", "shortest", "longest", "hurst", "patches", "step_factor", &
      "rest_angle", "yield_exponent", "fitted_radius"]
   character(len=long), parameter :: ground_keys(5) = [character(len=long) :: &
      "yield_pressure", "restitution", "friction", "soil_density", "plough"]

contains

   pure type(ground_t) function ground_of(v)
      real(wp), intent(in) :: v(size(ground_keys))  !! values in the [units] of ground_t

      ground_of = ground_t(yield_pressure=v(1), restitution=v(2), friction=v(3), soil_density=v(4), &
                           plough=nint(v(5)) /= 0)
   end function ground_of

   pure function ground_row(g) result(row)
      type(ground_t), intent(in) :: g
      real(wp) :: row(size(ground_keys))

      row = [g%yield_pressure, g%restitution, g%friction, g%soil_density, merge(1.0_wp, 0.0_wp, g%plough)]
   end function ground_row

   pure type(plan_t) function plan_of(v)
      real(wp), intent(in) :: v(size(plan_keys))  !! values in the [units] of plan_t

      plan_of = plan_t(radius=v(1), density=v(2), count=nint(v(3)), edge=v(4), relief=v(5), shortest=v(6), &
                       longest=v(7), hurst=v(8), patches=nint(v(9)), step_factor=v(10), rest_angle=v(11), &
                       yield_exponent=v(12), fitted_radius=v(13))
   end function plan_of

   pure function plan_row(p) result(row)
      type(plan_t), intent(in) :: p
      real(wp) :: row(size(plan_keys))

      row = [p%radius, p%density, real(p%count, wp), p%edge, p%relief, p%shortest, p%longest, p%hurst, &
             real(p%patches, wp), p%step_factor, p%rest_angle, p%yield_exponent, p%fitted_radius]
   end function plan_row

   pure subroutine check_plan(p, error)
      type(plan_t), intent(in) :: p
      type(error_t), allocatable, intent(out) :: error

      if (.not. (p%radius >= 0.01_wp .and. p%radius <= 10)) then
         call fail(error, "block: radius must be 0.01 to 10 m")
      else if (.not. (p%density >= 100 .and. p%density <= 10000)) then
         call fail(error, "block: density must be 100 to 10000 kg/m3")
      else if (p%count < 1 .or. p%count > 10000) then
         call fail(error, "block: count must be 1 to 10000")
      else if (.not. (p%edge >= 0.2_wp .and. p%edge <= 10)) then
         call fail(error, "block: edge must be 0.2 to 10 (over R_b)")
      else if (.not. (p%relief >= 0 .and. p%relief <= 45)) then
         call fail(error, "ground: relief must be 0 (flat) to 45 degrees")
      else if (.not. (p%shortest >= 0.5_wp .and. p%shortest <= p%longest .and. p%longest <= 16*p%shortest)) then
         call fail(error, "ground: shortest must be at least 0.5, longest from it to 16 times it (over R_b)")
      else if (.not. (p%hurst >= 0 .and. p%hurst <= 2)) then
         call fail(error, "ground: hurst must be 0 to 2")
      else if (p%patches < 1 .or. p%patches > 64) then
         call fail(error, "ground: patches must be 1 to 64")
      else if (.not. (p%step_factor >= 0.01_wp .and. p%step_factor <= 4)) then
         call fail(error, "throw: step_factor must be 0.01 to 4")
      else if (.not. (p%rest_angle >= 0 .and. p%rest_angle <= 90)) then
         call fail(error, "ground: rest_angle must be 0 to 90 degrees")
      else if (.not. (p%yield_exponent >= 0 .and. p%yield_exponent <= 1)) then
         call fail(error, "ground: yield_exponent must be 0 to 1")
      else if (.not. (p%fitted_radius > 0 .and. p%fitted_radius <= 100)) then
         call fail(error, "ground: fitted_radius must be > 0 and <= 100 m")
      end if
   end subroutine check_plan
end module lab_block_tables
