! SPDX-License-Identifier: BSD-3-Clause
!> Breakage of a boulder into fragments by a fractal rule (Ruiz-Carulla et al. 2017; Matas et al. 2017, 2020; theory,
!> chapter 3): decision to break, volumes of the fragments (conserving the total volume), and their directions.
module rockfall_breakage
   use rockfall_kinds, only: wp
   use rockfall_math, only: logarithm, cube_root, power, sine_cosine
   use rockfall_boulder, only: boulder_t, sphere_radius
   use rockfall_direction, only: random_heading
   implicit none
   private
   public :: breakage_t, split_t, area_ratio, fractal_dimension, surviving_fraction, split_volume, fragment_of
   public :: direction_in_cone, away_from_ground, kept_energy

   !> New surface created by the energy E: S = new_area E**area_power [m2], E in J.
   real(wp), parameter :: new_area = 0.0031_wp, area_power = 0.7562_wp
   real(wp), parameter :: kept_energy = 0.99_wp  !! kinetic energy after breaking relative to the energy before [-]
   !> Area ratio at which the published dimension D is largest. Beyond it, the published straight lines of b and q would
   !> give fewer fragments, and none from 0.646 on (D < 0), so D stays constant.
   real(wp), parameter :: ratio_of_max_dimension = 0.43_wp

   !> Conditions of breakage, and parameters of the fragments.
   type :: breakage_t
      logical :: at_release = .false., at_impact = .false.
      real(wp) :: min_ratio = 0.0_wp     !! area ratio above which a boulder breaks [-]
      real(wp) :: release_fall = 0.0_wp  !! fall height that breaks a block at its release [m]
      real(wp) :: min_volume = 0.0_wp    !! minimum volume of a fragment; smaller ones are fines [m3]
      integer :: max_fragments = 1       !! maximum number of fragments of a released boulder
      real(wp) :: half_angle = 0.0_wp    !! maximum angle between the velocities of a fragment and of the boulder [rad]
   end type breakage_t

   !> Result of breaking a volume.
   type :: split_t
      real(wp), allocatable :: volume(:)  !! volumes of the fragments [m3]; a single volume if the block does not break
      real(wp) :: fines = 0.0_wp          !! volume left in smaller pieces [m3]
      logical :: capped = .false.         !! the maximum number of fragments was reached
   end type split_t

contains

   !> Area ratio [-] of an impact: new surface divided by its sum with the surface of a cube of the boulder's volume.
   elemental real(wp) function area_ratio(energy, volume)
      real(wp), intent(in) :: energy  !! energy of the motion normal to the ground [J]
      real(wp), intent(in) :: volume  !! [m3]
      real(wp) :: area, side

      area = 0
      if (energy > 0) area = new_area*power(energy, area_power)
      side = cube_root(volume)
      area_ratio = area/(area + 6*side*side)
   end function area_ratio

   !> Fraction of the volume in the largest fragment, q [-].
   elemental real(wp) function surviving_fraction(ratio)
      real(wp), intent(in) :: ratio  !! area ratio [-]

      surviving_fraction = 1 - 0.5125_wp*ratio
   end function surviving_fraction

   !> Fractal dimension D [-] of the fragments: the number of fragments above a volume V falls as V**-D.
   elemental real(wp) function fractal_dimension(ratio) result(dimension)
      real(wp), intent(in) :: ratio  !! area ratio, at least 0.25 [-]
      real(wp) :: held, b

      held = min(ratio, ratio_of_max_dimension)
      b = 2.4875_wp - 1.6125_wp*held
      dimension = 3 + logarithm(1 - surviving_fraction(held))/logarithm(b)
   end function fractal_dimension

   !> Split a volume into at most `room` fragments of at least `min_volume`. Fragment i of a series takes q i**(-1/D) of
   !> the volume being split. The remainder of a series is split again by the same rule, or stays one block once the
   !> maximum number is reached. Each fragment is subtracted from the remainder, so all volumes add up.
   pure subroutine split_volume(volume, ratio, min_volume, room, split)
      real(wp), intent(in) :: volume      !! [m3]
      real(wp), intent(in) :: ratio       !! area ratio [-]
      real(wp), intent(in) :: min_volume  !! [m3]
      integer, intent(in) :: room         !! maximum number of fragments
      type(split_t), intent(out) :: split
      real(wp) :: q, power_of_rank, rest, first, next, left, after
      integer :: i

      q = surviving_fraction(ratio)
      power_of_rank = -1/fractal_dimension(ratio)
      split%volume = [volume]
      if (q*volume < min_volume) return
      split%volume = [real(wp) ::]
      rest = volume
      do while (q*rest >= min_volume)
         first = q*rest
         next = first
         i = 1
         do while (next >= min_volume)
            i = i + 1
            left = rest - next
            after = min(left, first*power(real(i, wp), power_of_rank))
            split%capped = size(split%volume) + 1 == room .and. max(after, q*left) >= min_volume
            split%volume = [split%volume, merge(rest, next, split%capped)]
            rest = merge(0.0_wp, left, split%capped)
            next = merge(0.0_wp, after, split%capped)
         end do
      end do
      split%fines = rest
   end subroutine split_volume

   elemental type(boulder_t) function fragment_of(boulder, volume) result(fragment)
      type(boulder_t), intent(in) :: boulder
      real(wp), intent(in) :: volume  !! volume of the fragment [m3]

      fragment%volume = volume
      fragment%radius = sphere_radius(volume)
      fragment%mass = boulder%mass*(volume/boulder%volume)
   end function fragment_of

   !> Velocity of equal magnitude, distributed uniformly within a cone around a velocity.
   pure function direction_in_cone(v, half_angle, u) result(turned)
      real(wp), intent(in) :: v(3)        !! [m/s]
      real(wp), intent(in) :: half_angle  !! half angle of the cone, 0 to 45 degrees [rad]
      real(wp), intent(in) :: u(2)        !! uniform in (0, 1) [-]
      real(wp) :: turned(3), speed, axis(3), across(3), beside(3), sine, cosine, around(2)

      turned = v
      speed = sqrt(dot_product(v, v))
      if (.not. speed > 0) return
      axis = v/speed
      across = [axis(2), -axis(1), 0.0_wp]
      if (abs(axis(3)) > 0.8_wp) across = [0.0_wp, axis(3), -axis(2)]
      across = across/sqrt(dot_product(across, across))
      beside = [axis(2)*across(3) - axis(3)*across(2), axis(3)*across(1) - axis(1)*across(3), &
                axis(1)*across(2) - axis(2)*across(1)]
      call sine_cosine(half_angle, sine, cosine)
      cosine = 1 - u(1)*(1 - cosine)  ! uniform on the sphere
      sine = sqrt((1 - cosine)*(1 + cosine))
      around = random_heading(u(2))
      turned = speed*(cosine*axis + sine*(around(1)*across + around(2)*beside))
   end function direction_in_cone

   !> Velocity that points away from the ground; a velocity into the ground is mirrored.
   pure function away_from_ground(v, g) result(away)
      real(wp), intent(in) :: v(3)  !! [m/s]
      real(wp), intent(in) :: g(2)  !! gradient of the ground [-]
      real(wp) :: away(3), normal(3)

      normal = [-g(1), -g(2), 1.0_wp]
      away = v - min(0.0_wp, dot_product(v, normal))*(2/dot_product(normal, normal))*normal
   end function away_from_ground
end module rockfall_breakage
