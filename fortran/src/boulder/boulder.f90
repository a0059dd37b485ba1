! SPDX-License-Identifier: BSD-3-Clause
!> Boulders as spheres of random volume, with their release points and conditions
!> (Bourrier et al. 2009, sections 2 and 3.4).
module rockfall_boulder
   use rockfall_kinds, only: wp, i8
   use rockfall_math, only: pi, logarithm, exponential, cube_root, power
   use rockfall_random, only: random_key_t, random_words, uniform, normal, normal_table_t, for_release, &
                              words_per_block, volume_word
   implicit none
   private
   public :: boulder_t, soil_draw_t, source_boulder_t, feature_t, volume_distribution_t, release_t, draw_boulder
   public :: boulder_of
   public :: list_item, max_volume, usual_volumes, mean_volume, feature_of
   public :: source_of, first_of, last_of, released_by, inertia_factor, sphere_radius, kinetic_energy
   public :: fixed_volume, normal_volume, uniform_volume, lognormal_volume, list_volume, pareto_volume, distributions

   real(wp), parameter :: inertia_factor = 0.4_wp  !! I/(m R_b**2) of a sphere [-]
   integer, parameter :: fixed_volume = 1, normal_volume = 2, uniform_volume = 3, lognormal_volume = 4, &
                         list_volume = 5, pareto_volume = 6
   character(len=*), parameter :: distributions(*) = [character(len=9) :: "fixed", "normal", "uniform", "lognormal", &
                                                      "list", "pareto"]  !! in the order of the constants above

   !> Volume distribution, and the density that converts volumes to masses.
   type :: volume_distribution_t
      integer :: kind = fixed_volume
      real(wp) :: mean = 1.0_wp              !! fixed, normal, lognormal [m3]
      real(wp) :: std = 0.0_wp               !! normal (before truncation at zero), lognormal [m3]
      real(wp) :: min = 0.0_wp, max = 0.0_wp !! uniform, pareto [m3]
      real(wp) :: exponent = 1.0_wp          !! pareto: the number of boulders above V falls as V**-exponent, > 0 [-]
      real(wp), allocatable :: list(:)       !! list: all equally probable [m3]
      integer, allocatable :: list_shape(:)  !! block shape of each volume, if known
      !> density [kg/m3]; 2800 is implied by the energies and volumes in the paper
      real(wp) :: density = 2800.0_wp
   end type volume_distribution_t

   type :: boulder_t
      real(wp) :: volume = 0  !! [m3]
      real(wp) :: radius = 0  !! R_b [m]
      real(wp) :: mass = 0    !! [kg]
   end type boulder_t

   !> Random properties of a boulder that modify all grounds along its path.
   type :: soil_draw_t
      real(wp) :: deviate = 0.0_wp  !! standard normal number for the strength of the ground [-]
      real(wp) :: column = 0.5_wp, row = 0.5_wp  !! uniform in (0, 1): choice between parts of an impact table [-]
      real(wp) :: ratio_factor = 1.0_wp          !! factor on R_b/R_m [-]
   end type soil_draw_t

   !> Boulder specified by a source.
   type :: source_boulder_t
      real(wp) :: volume = 0                !! [m3]
      real(wp) :: density = 0               !! [kg/m3]
      real(wp) :: inertia = inertia_factor  !! I/(m R_b**2), with R_b of the sphere of equal volume [-]
   end type source_boulder_t

   !> Release attributes of a feature of the source layer: a polygon with all sources inside it, or a point.
   type :: feature_t
      type(volume_distribution_t) :: volumes
      real(wp) :: drop_height = 0.0_wp       !! height above the surface [m]
      real(wp) :: velocity(3) = 0.0_wp       !! east, north, up [m/s]
   end type feature_t

   !> Releases. Boulders are numbered source by source. Either every source releases the same number n, and boulder b
   !> has source (b-1)/n + 1, or the numbers differ, and `last` gives the last boulder of each source.
   type :: release_t
      real(wp), allocatable :: x(:), y(:)    !! local coordinates of each source [m]
      integer(i8) :: boulders_per_source = 1
      integer(i8), allocatable :: last(:)    !! last boulder of each source, non-decreasing
      real(wp) :: drop_height = 0.0_wp       !! height above the surface [m]
      real(wp) :: velocity(3) = 0.0_wp       !! east, north, up [m/s]
      integer, allocatable :: feature(:)     !! feature index of each source, if the sources come from a layer
   end type release_t

contains

   !> Source of a boulder; by bisection if sources release different numbers.
   pure integer(i8) function source_of(release, boulder)
      type(release_t), intent(in) :: release
      integer(i8), intent(in) :: boulder  !! 1..
      integer(i8) :: low, middle

      if (.not. allocated(release%last)) then
         source_of = (boulder - 1)/release%boulders_per_source + 1
         return
      end if
      low = 1
      source_of = size(release%last)
      do while (low < source_of)
         middle = (low + source_of)/2
         if (release%last(middle) >= boulder) then
            source_of = middle
         else
            low = middle + 1
         end if
      end do
   end function source_of

   !> Number of the first boulder of a source.
   pure integer(i8) function first_of(release, source)
      type(release_t), intent(in) :: release
      integer(i8), intent(in) :: source  !! 1..

      first_of = 1
      if (source > 1) first_of = last_of(release, source - 1) + 1
   end function first_of

   !> Number of the last boulder of a source.
   pure integer(i8) function last_of(release, source)
      type(release_t), intent(in) :: release
      integer(i8), intent(in) :: source  !! 1..

      if (allocated(release%last)) then
         last_of = release%last(source)
      else
         last_of = source*release%boulders_per_source
      end if
   end function last_of

   !> Index of the feature of the source layer to which a source belongs; 0 if there is no such layer.
   pure integer function feature_of(release, source)
      type(release_t), intent(in) :: release
      integer(i8), intent(in) :: source  !! 1..

      feature_of = 0
      if (allocated(release%feature)) feature_of = release%feature(source)
   end function feature_of

   !> Number of boulders released by a source.
   pure integer(i8) function released_by(release, source)
      type(release_t), intent(in) :: release
      integer(i8), intent(in) :: source  !! 1..

      released_by = last_of(release, source) - first_of(release, source) + 1
   end function released_by

   !> Draw the volume of boulder `number`, and the radius and mass of a sphere of this volume.
   pure type(boulder_t) function draw_boulder(distribution, table, key, number) result(boulder)
      type(volume_distribution_t), intent(in) :: distribution
      type(normal_table_t), intent(in) :: table
      type(random_key_t), intent(in) :: key
      integer(i8), intent(in) :: number
      integer(i8) :: word(words_per_block)

      word = random_words(key, for_release, number, 0_i8, 0_i8)
      select case (distribution%kind)
      case (normal_volume)
         boulder%volume = truncated_normal(distribution, table, key, number, word(volume_word))
      case (uniform_volume)
         boulder%volume = distribution%min + (distribution%max - distribution%min)*uniform(word(volume_word))
      case (lognormal_volume)
         boulder%volume = lognormal(distribution, normal(table, word(volume_word)))
      case (pareto_volume)
         boulder%volume = pareto(distribution, uniform(word(volume_word)))
      case (list_volume)
         boulder%volume = distribution%list(list_item(distribution, word(volume_word)))
      case default
         boulder%volume = distribution%mean
      end select
      boulder%radius = sphere_radius(boulder%volume)
      boulder%mass = distribution%density*boulder%volume
   end function draw_boulder

   !> Index of the listed volume selected by a random word.
   pure integer function list_item(distribution, word)
      type(volume_distribution_t), intent(in) :: distribution
      integer(i8), intent(in) :: word

      list_item = 1 + int(uniform(word)*size(distribution%list))
   end function list_item

   !> Boulder as specified by its source.
   pure type(boulder_t) function boulder_of(source, factor) result(boulder)
      type(source_boulder_t), intent(in) :: source
      real(wp), intent(in) :: factor  !! factor on the volume given for the source [-]

      boulder%volume = factor*source%volume
      boulder%radius = sphere_radius(boulder%volume)
      boulder%mass = source%density*boulder%volume
   end function boulder_of

   !> Radius of a sphere [m].
   elemental real(wp) function sphere_radius(volume) result(radius)
      real(wp), intent(in) :: volume  !! [m3]

      radius = cube_root(3*volume/(4*pi))
   end function sphere_radius

   !> Translational and rotational energy [J] (Bourrier et al. 2009, eqs 1-3).
   pure function kinetic_energy(boulder, v, omega) result(energy)
      type(boulder_t), intent(in) :: boulder
      real(wp), intent(in) :: v(3)   !! [m/s]
      real(wp), intent(in) :: omega  !! [rad/s]
      real(wp) :: energy(2), spin

      spin = omega*boulder%radius
      energy = [0.5_wp*boulder%mass*(v(1)**2 + v(2)**2 + v(3)**2), 0.5_wp*inertia_factor*boulder%mass*spin**2]
   end function kinetic_energy

   !> Maximum volume that can be drawn [m3].
   pure real(wp) function max_volume(distribution, table) result(volume)
      type(volume_distribution_t), intent(in) :: distribution
      type(normal_table_t), intent(in) :: table
      integer(i8), parameter :: last_word = 2_i8**32 - 1

      select case (distribution%kind)
      case (normal_volume); volume = distribution%mean + distribution%std*normal(table, last_word)
      case (uniform_volume, pareto_volume); volume = distribution%max
      case (lognormal_volume); volume = lognormal(distribution, normal(table, last_word))
      case (list_volume); volume = maxval(distribution%list)
      case default; volume = distribution%mean
      end select
   end function max_volume

   !> Range of volumes [m3] that contains all but a few boulders.
   pure function usual_volumes(distribution) result(limits)
      type(volume_distribution_t), intent(in) :: distribution
      real(wp) :: limits(2)
      real(wp), parameter :: few = 3.7_wp  !! standard deviations; one in 10,000 lies beyond, on each side [-]

      select case (distribution%kind)
      case (normal_volume)
         limits = max(0.001_wp*distribution%mean, distribution%mean + [-few, few]*distribution%std)
      case (lognormal_volume); limits = [lognormal(distribution, -few), lognormal(distribution, few)]
      case (uniform_volume, pareto_volume); limits = [distribution%min, distribution%max]
      case (list_volume); limits = [minval(distribution%list), maxval(distribution%list)]
      case default; limits = distribution%mean
      end select
   end function usual_volumes

   !> Mean volume [m3]; an upper bound for a normal distribution, which is truncated at zero.
   pure real(wp) function mean_volume(distribution) result(volume)
      type(volume_distribution_t), intent(in) :: distribution

      select case (distribution%kind)
      ! the mean increases most, by sqrt(2/pi) std = 0.798 std, if it is zero before truncation
      case (normal_volume); volume = distribution%mean + 0.8_wp*distribution%std
      case (uniform_volume); volume = (distribution%min + distribution%max)/2
      case (pareto_volume); volume = mean_of_pareto(distribution)
      case (list_volume); volume = sum(distribution%list)/size(distribution%list)
      case default; volume = distribution%mean
      end select
   end function mean_volume

   !> Normally distributed volume [m3], redrawn until it is positive.
   pure real(wp) function truncated_normal(distribution, table, key, number, first) result(volume)
      type(volume_distribution_t), intent(in) :: distribution  !! mean > 0: at least half of the draws succeed
      type(normal_table_t), intent(in) :: table
      type(random_key_t), intent(in) :: key
      integer(i8), intent(in) :: number
      integer(i8), intent(in) :: first  !! random word for the first draw
      integer(i8) :: draw, word(words_per_block)

      volume = distribution%mean + distribution%std*normal(table, first)
      draw = 0
      do while (volume <= 0)
         draw = draw + 1
         word = random_words(key, for_release, number, 0_i8, draw)
         volume = distribution%mean + distribution%std*normal(table, word(volume_word))
      end do
   end function truncated_normal

   !> Lognormal volume [m3] with the given arithmetic mean and standard deviation:
   !> its logarithm has the variance s2 = ln(1 + (std/mean)**2) and the mean ln(mean) - s2/2.
   pure real(wp) function lognormal(distribution, z)
      type(volume_distribution_t), intent(in) :: distribution
      real(wp), intent(in) :: z  !! standard normal [-]
      real(wp) :: variance

      variance = logarithm(1 + (distribution%std/distribution%mean)**2)
      lognormal = distribution%mean*exponential(sqrt(variance)*z - variance/2)
   end function lognormal

   !> Volume [m3] of a truncated power-law distribution: the number of boulders larger than V decreases as V**-exponent.
   pure real(wp) function pareto(distribution, u) result(volume)
      type(volume_distribution_t), intent(in) :: distribution
      real(wp), intent(in) :: u  !! uniform, 0 to 1

      associate (range => distribution%max/distribution%min, b => distribution%exponent)
         volume = distribution%min*power(1 - u*(1 - power(range, -b)), -1/b)
      end associate
      volume = min(max(volume, distribution%min), distribution%max)
   end function pareto

   pure real(wp) function mean_of_pareto(distribution) result(volume)
      type(volume_distribution_t), intent(in) :: distribution
      real(wp), parameter :: near_one = 1e-6_wp
      real(wp) :: integral

      volume = distribution%min
      if (distribution%max <= distribution%min) return
      associate (range => distribution%max/distribution%min, b => distribution%exponent)
         if (abs(1 - b) < near_one) then
            integral = logarithm(range)
         else
            integral = (power(range, 1 - b) - 1)/(1 - b)
         end if
         volume = volume*b*integral/(1 - power(range, -b))
      end associate
   end function mean_of_pareto
end module rockfall_boulder
