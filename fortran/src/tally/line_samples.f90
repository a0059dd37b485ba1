! SPDX-License-Identifier: BSD-3-Clause
!> Samples of boulders whose rows are not kept: quantities at each line and at the end of each boulder. Samples cover
!> all boulders, each part (feature or source in statistics) and, coarsely, groups of sources for confidence intervals.
module rockfall_line_samples
   use rockfall_kinds, only: wp, sp, i4, i8
   use rockfall_math, only: rounded_up
   use rockfall_line, only: line_t
   use rockfall_boulder, only: release_t, feature_of
   use rockfall_samples, only: samples_t, add_numbers, add_tails, largest_unit
   use rockfall_variables, only: boulder_fields, boulder_counts, line_fields
   implicit none
   private
   public :: layout_t, layout_of, add_end, add_crossings, line_quantities, place_along, point_along
   public :: line_quantity, end_quantity, units_of, n_quantities, tails

   !> Quantities at a line (only the first `n_tails` may have tails), and quantities at the end of a boulder.
   character(len=20), parameter :: line_quantity(*) = [character(len=20) :: &
      "speed", "jump_height", "passing_height", "energy_translational", "energy_rotational", "energy_total", "omega", &
      "rotational_share", "upper_edge", "normal_height", "normal_upper_edge", "position"]
   character(len=20), parameter :: end_quantity(*) = [character(len=20) :: &
      "plan_distance", "path_length", "travel_time", "speed_max", "jump_height_max", "volume", "impacts"]
   integer, parameter :: n_quantities = size(line_quantity), tails = 6
   !> Units of samples per SI unit: at lines mm/s, mm, J, mrad/s, millionths; at ends mm, ms, mm/s, cm3, 1.
   real(wp), parameter :: mega = 1.0e6_wp, kilo = 1.0e3_wp, unity = 1.0_wp
   real(wp), parameter :: units_of(n_quantities, 2) = reshape( &
      [kilo, kilo, kilo, unity, unity, unity, kilo, mega, kilo, kilo, kilo, kilo, &
       kilo, kilo, kilo, kilo, kilo, mega, unity, unity, unity, unity, unity, unity], [n_quantities, 2])

   integer, parameter :: max_parts = 50, ranges = 20  !! maximum number of parts; if there are more, `ranges` parts
   integer, parameter :: max_parted = 256             !! maximum number of parts times places (0.6 MB each)
   integer, parameter :: max_grouped = 2048           !! maximum number of groups times places (10 kB each)

   integer, parameter :: volume = findloc(boulder_fields, "volume", dim=1)
   integer, parameter :: status = findloc(boulder_counts, "status", dim=1), &
                         impacts = findloc(boulder_counts, "impacts", dim=1), &
                         source = findloc(boulder_counts, "source", dim=1)

   integer, parameter :: speed_row = findloc(line_fields, "speed", dim=1), &
                         jump_row = findloc(line_fields, "jump_height", dim=1), &
                         passing_row = findloc(line_fields, "passing_height", dim=1), &
                         omega_row = findloc(line_fields, "omega", dim=1), &
                         forward_row = findloc(line_fields, "energy_translational", dim=1), &
                         turning_row = findloc(line_fields, "energy_rotational", dim=1)

   !> Parts and groups of the sources; a group belongs to one part.
   type :: layout_t
      integer(i4), allocatable :: part(:), group(:)  !! part and group of each source
      integer(i4), allocatable :: part_last(:)       !! last feature or source of each part
      integer(i4), allocatable :: group_part(:)      !! part of each group
   end type layout_t

contains

   !> Build the layout: one group per source if memory permits; otherwise neighbouring sources are grouped.
   pure function layout_of(release, places) result(layout)
      type(release_t), intent(in) :: release
      integer, intent(in) :: places  !! number of lines, plus one for the end
      type(layout_t) :: layout
      integer :: n_groups, max_count, n, each, k, p
      integer, allocatable :: n_seen(:), n_sources(:)

      n = size(release%x)
      n_groups = n
      if (allocated(release%feature)) n_groups = maxval(release%feature)
      max_count = max(1, max_parted/places)
      layout%part_last = [(k, k=1, n_groups)]
      if (n_groups > min(max_parts, max_count)) then
         max_count = min(ranges, max_count)
         layout%part_last = [(k*(n_groups/max_count) + min(k, mod(n_groups, max_count)), k=1, max_count)]
      end if
      allocate (layout%part(n), layout%group(n))
      allocate (n_seen(size(layout%part_last)), n_sources(size(layout%part_last)), source=0)
      do k = 1, n
         p = k
         if (allocated(release%feature)) p = feature_of(release, int(k, i8))
         layout%part(k) = count(layout%part_last < p) + 1
         n_sources(layout%part(k)) = n_sources(layout%part(k)) + 1
      end do
      if (n*int(places, i8) <= max_grouped) then
         layout%group = [(k, k=1, n)]
         layout%group_part = layout%part
         return
      end if
      each = max(1, max_grouped/(places*size(n_sources)))
      do k = 1, n
         p = layout%part(k)
         layout%group(k) = (p - 1)*each + 1 + int(n_seen(p)*int(each, i8)/n_sources(p))
         n_seen(p) = n_seen(p) + 1
      end do
      layout%group_part = [((p, k=1, each), p=1, size(n_sources))]
   end function layout_of

   subroutine add_end(samples, layout, boulder, counts)
      type(samples_t), intent(inout) :: samples
      type(layout_t), intent(in) :: layout
      real(wp), intent(in) :: boulder(:)  !! boulder_fields
      integer, intent(in) :: counts(:)    !! boulder_counts
      real(wp) :: values(size(end_quantity))

      samples%ended(counts(status)) = samples%ended(counts(status)) + 1
      values = [boulder(findloc(boulder_fields, "plan_distance", dim=1)), &
                boulder(findloc(boulder_fields, "path_length", dim=1)), &
                boulder(findloc(boulder_fields, "travel_time", dim=1)), &
                boulder(findloc(boulder_fields, "speed_max", dim=1)), &
                boulder(findloc(boulder_fields, "jump_height_max", dim=1)), &
                boulder(volume), real(counts(impacts), wp)]
      call add_quantities(samples, layout, [counts(source)], reshape(values, [1, size(values)]), 2, 1)
   end subroutine add_end

   !> Add crossings of a line by boulders.
   subroutine add_crossings(samples, layout, index, line, origin, radii, sources, crossings)
      type(samples_t), intent(inout) :: samples
      type(layout_t), intent(in) :: layout
      integer, intent(in) :: index              !! index of the line
      type(line_t), intent(in) :: line
      real(wp), intent(in) :: origin(2)         !! origin of local coordinates [m]
      real(wp), intent(in) :: radii(:)          !! R_b of the boulders [m]
      integer, intent(in) :: sources(:)         !! source numbers
      real(wp), intent(in) :: crossings(:, :)   !! (line_fields, boulders)
      real(wp) :: values(size(radii), n_quantities)
      integer :: k

      do k = 1, size(radii)
         values(k, :n_quantities - 1) = line_quantities(crossings(:, k), radii(k))
         values(k, n_quantities) = place_along(line, crossings(:2, k) - origin)
      end do
      call add_quantities(samples, layout, sources, values, 1, index + 1)
      call add_tails(samples, index, rounded_up(values(:, :tails)))
   end subroutine add_crossings

   !> Add the quantities of boulders at a place.
   subroutine add_quantities(samples, layout, sources, values, kind, place)
      type(samples_t), intent(inout) :: samples
      type(layout_t), intent(in) :: layout
      integer, intent(in) :: sources(:)      !! source of each boulder
      real(wp), intent(in) :: values(:, :)   !! (boulders, quantities)
      integer, intent(in) :: kind, place     !! 1 for lines, 2 for ends; place as in samples_t
      real(wp), parameter :: limit = real(largest_unit, wp)
      integer(i4), dimension(size(sources)) :: part, group
      integer :: q

      part = layout%part(sources)
      group = layout%group(sources)
      do q = 1, size(values, 2)
         call add_numbers(samples, nint(max(-limit, min(limit, values(:, q)*units_of(q, kind))), i8), q, part, group, &
                          place)
      end do
   end subroutine add_quantities

   !> Quantities at a line, except the last, from its row; NaN if not available. The centre of a boulder in contact with
   !> the ground is R_b/cos(slope) vertically above it, and R_b along the normal. In flight, the jump height is added to
   !> the first distance, and its component along the normal to the second.
   pure function line_quantities(row, radius) result(q)
      real(wp), intent(in) :: row(:)  !! line_fields
      real(wp), intent(in) :: radius  !! R_b [m]
      real(wp) :: q(n_quantities - 1)
      real(wp) :: rotational_fraction, normal

      associate (speed => row(speed_row), jump => row(jump_row), passing => row(passing_row), omega => row(omega_row), &
                 forward => row(forward_row), turning => row(turning_row))
         rotational_fraction = turning
         if (forward + turning > 0) rotational_fraction = turning/(forward + turning)
         normal = jump*min(1.0_wp, radius/(passing - jump)) + radius
         q = [speed, jump, passing, forward, turning, forward + turning, omega, rotational_fraction, &
              passing + radius, normal, normal + radius]
      end associate
   end function line_quantities

   !> Distance along a line [m] from its first vertex to the point of the line nearest to a given point.
   pure real(wp) function place_along(line, point) result(along)
      type(line_t), intent(in) :: line
      real(wp), intent(in) :: point(2)  !! [m]
      real(wp) :: start(2), side(2), length, along_side, distance2, min_distance2, before
      integer :: k

      along = 0
      before = 0
      min_distance2 = huge(min_distance2)
      do k = 1, size(line%x) - 1
         start = [line%x(k), line%y(k)]
         side = [line%x(k + 1), line%y(k + 1)] - start
         length = sqrt(dot_product(side, side))
         if (length <= 0) cycle
         along_side = max(0.0_wp, min(length, dot_product(point - start, side)/length))
         distance2 = sum((point - start - along_side*side/length)**2)
         if (distance2 < min_distance2) along = before + along_side
         min_distance2 = min(min_distance2, distance2)
         before = before + length
      end do
   end function place_along

   !> Point of a line at a distance [m] along it, the inverse of `place_along`.
   pure function point_along(line, along) result(point)
      type(line_t), intent(in) :: line
      real(wp), intent(in) :: along  !! distance from the first vertex [m]
      real(wp) :: point(2), start(2), side(2), length, before
      integer :: k

      point = [line%x(1), line%y(1)]
      before = 0
      do k = 1, size(line%x) - 1
         start = [line%x(k), line%y(k)]
         side = [line%x(k + 1), line%y(k + 1)] - start
         length = sqrt(dot_product(side, side))
         if (length <= 0) cycle
         point = start + max(0.0_wp, min(1.0_wp, (along - before)/length))*side
         before = before + length
         if (along <= before) return
      end do
   end function point_along
end module rockfall_line_samples
