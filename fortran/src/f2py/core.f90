! SPDX-License-Identifier: BSD-3-Clause
!> Door 1: plain arrays for Python. No physics here. An optional array that is absent comes with a
!> single element, because f2py has no empty ones.
module rockfall_f2py
   use iso_c_binding, only: c_double, c_float, c_int, c_int8_t, c_int16_t, c_int32_t, c_int64_t
   use rockfall_error, only: error_t, give_error
   use rockfall_random, only: random_key
   use rockfall_sobol, only: sobol_sequence
   use rockfall_terrain, only: terrain_t, terrain, keep_within
   use rockfall_surface, only: size_weights
   use rockfall_impact, only: ratio_weights
   use rockfall_trajectory, only: scene_t, boulder_result_t, crossing_t, scratch_t
   use rockfall_scene, only: coefficients_t, set_sources, check_sources, add_line, set_impacts
   use rockfall_reach, only: block_side, take_minima, reach_box
   use rockfall_sources, only: usual_threshold, keep_steep, surface_ratios, last_boulders
   use rockfall_maps, only: maps_t, needs_visits
   use rockfall_map_values, only: map_plan_t, plan_maps => map_plan, map_views, map_row, map_min_count
   use rockfall_limits, only: check_map_tallies => check_tallies
   use rockfall_boulder, only: volume_distribution_t
   use rockfall_threads, only: team_size, check_team, release_team
   use rockfall_ensemble, only: run_boulders, trace_boulder
   use rockfall_result, only: boulder_row, boulder_count_row, line_row, vertex_row
   use rockfall_variables, only: variable_text, boulder_fields, boulder_counts, line_fields, &
                                 vertex_fields, map_fields
   use rockfall_histogram, only: bin_width, n_bins
   use rockfall_case, only: case_t, read_case, key_text, n_keys
   use rockfall_impact_sets, only: read_impact_sets => read_sets
   use rockfall_classicheader, only: claims_too_much => overstates
   implicit none
   private
   public :: run, survey, reach, block_of, map_plan, check_tallies, map_values, check_case, case_key, variable, read_sets, fields, &
             histogram_bins, team, team_fits, end_team, slope_threshold, steep_cells, area_ratios, release_ends, overstates, &
             weights_of_sets, weights_of_sizes

contains

   !> Follow boulders first .. first + n - 1 of a scene; maps and histograms are added to. With room > 1 (and
   !> n = 1) the vertices of the trajectory are kept too, up to `room` of `recorded`.
   subroutine run(z8, z4, west, north, cell, nodes, at, zone1, zone2, values, sizes, method, size_to_radius, &
                  set_mean, set_covariance, set_incidence, set_lateral, set_speed_range, set_angle_range, &
                  turning, between, gravity, stop_speed, impact_limit, &
                  law, law_values, volumes, density, source_x, source_y, sources_before, per_source, source_end, &
                  drop_height, velocity, &
                  lines, line_end, line_x, line_y, seed, sobol, first, threads, &
                  plan, map_at, map_last, map_counts, map_sums, map_reals, class_counts, column, columns, stamp, head, &
                  histograms, histogram, boulder, counts, crossing, vertex, recorded, code, message, &
                  nx8, ny8, nx4, ny4, nx1, ny1, nx2, ny2, nxv, nyv, nkv, ks, ms, nv, ns, nl, nlv, &
                  nxc, nyc, nkc, nxs, nys, nks, nxr, nyr, nkr, kc, cc, nxq, nyq, nxt, nyt, nkt, ne, n, room)
      !f2py threadsafe
      integer(c_int), intent(in) :: nx8, ny8, nx4, ny4, nx1, ny1, nx2, ny2, nxv, nyv, nkv, ks, ms, nv, ns, nl, nlv, &
                                    nxc, nyc, nkc, nxs, nys, nks, nxr, nyr, nkr, kc, cc, nxq, nyq, &
                                    nxt, nyt, nkt, ne, n, room
      real(c_double), intent(in), target :: z8(nx8, ny8)         !! elevations [m], or
      real(c_float), intent(in), target :: z4(nx4, ny4)          !! in single precision
      real(c_double), intent(in) :: west, north, cell            !! outer edges, cell size [m]
      integer(c_int), intent(in) :: nodes(2), at(2)              !! columns, rows of the raster; where arrays begin
      integer(c_int8_t), intent(in), target :: zone1(nx1, ny1)   !! column of `sizes`, or
      integer(c_int16_t), intent(in), target :: zone2(nx2, ny2)  !! of more than 127, or
      real(c_float), intent(in), target :: values(nxv, nyv, nkv) !! sizes of each cell [m]
      real(c_double), intent(in) :: sizes(ks, ms)                !! as in surface_t [m]
      integer(c_int), intent(in) :: method                       !! 1 = A, 2 = B
      real(c_double), intent(in) :: size_to_radius
      real(c_double), intent(in) :: set_mean(9, 5), set_covariance(9, 9, 5)  !! as in coefficients_t
      real(c_double), intent(in) :: set_incidence(8, 5), set_lateral(13, 9, 5)
      real(c_double), intent(in) :: set_speed_range(2, 5), set_angle_range(2, 5)
      integer(c_int), intent(in) :: turning                      !! rule of turning_t
      integer(c_int), intent(in) :: between                      !! ratios: 0 or 1
      real(c_double), intent(in) :: gravity, stop_speed          !! [m/s2], [m/s]
      integer(c_int), intent(in) :: impact_limit
      integer(c_int), intent(in) :: law                          !! as in volume_distribution_t
      real(c_double), intent(in) :: law_values(4), volumes(nv)   !! mean, deviation, least, most; list [m3]
      real(c_double), intent(in) :: density                      !! [kg/m3]
      real(c_double), intent(in) :: source_x(ns), source_y(ns)   !! map coordinates [m], of all sources or those
      integer(c_int64_t), intent(in) :: sources_before           !! of boulders first .. first + n - 1
      integer(c_int64_t), intent(in) :: per_source               !! boulders of each source, or
      integer(c_int64_t), intent(in) :: source_end(ne)           !! the last boulder of each of all
      real(c_double), intent(in) :: drop_height, velocity(3)     !! [m], [m/s]
      integer(c_int), intent(in) :: lines                        !! how many; vertices up to line_end(k)
      integer(c_int), intent(in) :: line_end(nl)
      real(c_double), intent(in) :: line_x(nlv), line_y(nlv)     !! map coordinates [m]
      integer(c_int64_t), intent(in) :: seed, first
      integer(c_int), intent(in) :: sobol                        !! dimensions: 0, 1 (volume) or 13 (first draw)
      integer(c_int), intent(in) :: threads
      integer(c_int), intent(in) :: plan(14)                     !! of `map_plan`
      integer(c_int), intent(in) :: map_at(2), map_last(2)       !! first and last column, row of maps
      integer(c_int32_t), intent(inout), target :: map_counts(nxc, nyc, nkc)  !! stacks, as in map_views
      integer(c_int64_t), intent(inout), target :: map_sums(nxs, nys, nks)
      real(c_float), intent(inout), target :: map_reals(nxr, nyr, nkr)
      integer(c_int32_t), intent(inout), target :: class_counts(kc, cc), column(nxq, nyq), columns(1)
      integer(c_int32_t), intent(inout), target :: stamp(nxt, nyt, nkt)  !! as in maps_t, with its `head`
      integer(c_int64_t), intent(in) :: head
      integer(c_int), intent(in) :: histograms                   !! 0: none
      integer(c_int64_t), intent(inout) :: histogram(50, 6)
      real(c_double), intent(out) :: boulder(12, n)              !! boulder_fields
      integer(c_int32_t), intent(out) :: counts(8, n)            !! boulder_counts
      real(c_double), intent(out) :: crossing(12, nl, n)         !! line_fields
      real(c_double), intent(out) :: vertex(14, room)            !! vertex_fields
      integer(c_int), intent(out) :: recorded
      integer(c_int), intent(out) :: code                        !! 0 = success
      character(len=1024), intent(out) :: message
      type(scene_t) :: scene
      type(maps_t) :: maps
      type(error_t), allocatable :: error

      recorded = 0
      boulder = 0
      counts = 0
      crossing = 0
      vertex = 0
      scene%key = random_key(seed)
      if (sobol > 0) scene%sobol = sobol_sequence(sobol)
      scene%gravity = gravity
      scene%stop_speed = stop_speed
      scene%between_ratios = between /= 0
      scene%max_impacts = impact_limit
      call set_terrain(scene%dem, z8, z4, west, north, cell, nodes, at)
      call keep_within(scene%dem, map_at, map_last)
      call set_surface()
      call set_boulders()
      call set_lines()
      maps = map_views(as_plan(plan), map_at, map_counts, map_sums, map_reals, class_counts, column, columns(1))
      maps%last_source(map_at(1):, map_at(2):, 1:) => stamp
      maps%first_partial = head
      scene%cells_requested = needs_visits(maps)
      scene%histograms_requested = histograms /= 0
      call set_impacts(scene, coefficients_t(set_mean, set_covariance, set_incidence, set_lateral, &
                                                 set_speed_range, set_angle_range), turning, error)
      call give_error(error, code, message)
      if (code /= 0) return
      if (room > 1) then
         call trace()
      else
         call follow_all()
      end if

   contains

      subroutine set_surface()
         scene%surface%method = method
         scene%surface%size_to_radius = size_to_radius
         scene%surface%sizes = sizes
         if (size(zone1) > 1) scene%surface%zone1(at(1):, at(2):) => zone1
         if (size(zone2) > 1) scene%surface%zone2(at(1):, at(2):) => zone2
         if (size(values) > 1) scene%surface%values(at(1):, at(2):, 1:) => values
      end subroutine set_surface

      subroutine set_boulders()
         scene%volumes = as_law(law, law_values, volumes, density)
         scene%release%before = sources_before
         scene%release%boulders_per_source = per_source
         if (size(source_end) > 1) scene%release%last = source_end
         scene%release%drop_height = drop_height
         scene%release%velocity = velocity
         call set_sources(scene, source_x, source_y)
      end subroutine set_boulders

      subroutine set_lines()
         integer :: k, from

         from = 1
         do k = 1, lines
            call add_line(scene, line_x(from:line_end(k)), line_y(from:line_end(k)))
            from = line_end(k) + 1
         end do
      end subroutine set_lines

      subroutine follow_all()
         type(boulder_result_t), allocatable :: fates(:)
         type(crossing_t), allocatable :: crossings(:, :)
         integer :: k, l

         allocate (fates(n), crossings(lines, n))
         call run_boulders(scene, first, threads, fates, crossings, maps, histogram)
         do k = 1, n
            boulder(:, k) = boulder_row(scene%dem, fates(k))
            counts(:, k) = boulder_count_row(fates(k))
            do l = 1, lines
               crossing(:, l, k) = line_row(scene%dem, fates(k), crossings(l, k))
            end do
         end do
      end subroutine follow_all

      subroutine trace()
         type(boulder_result_t) :: fate
         type(scratch_t) :: scratch
         integer :: k

         call trace_boulder(scene, first, room, fate, scratch)
         boulder(:, 1) = boulder_row(scene%dem, fate)
         counts(:, 1) = boulder_count_row(fate)
         recorded = scratch%recorded
         do k = 1, min(room, recorded)
            vertex(:, k) = vertex_row(scene%dem, scratch%record(k))
         end do
      end subroutine trace
   end subroutine run

   !> The array that there is as a terrain.
   subroutine set_terrain(dem, z8, z4, west, north, cell, nodes, at)
      type(terrain_t), intent(out) :: dem
      real(c_double), intent(in), target, contiguous :: z8(:, :)
      real(c_float), intent(in), target, contiguous :: z4(:, :)
      real(c_double), intent(in) :: west, north, cell
      integer(c_int), intent(in) :: nodes(2), at(2)

      if (size(z8) > 1) then
         dem = terrain(west, north, cell, z8=z8, nodes=nodes, first=at)
      else
         dem = terrain(west, north, cell, z4=z4, nodes=nodes, first=at)
      end if
   end subroutine set_terrain

   !> Look at rows first to last of the terrain: lower the minima of blocks, check the sources there and raise
   !> their energy head, as in rockfall_reach and check_sources.
   subroutine survey(z8, z4, west, north, cell, nodes, at, source_x, source_y, drop_height, velocity, gravity, &
                     first, last, minima, head, code, message, nx8, ny8, nx4, ny4, ns, nbx, nby)
      !f2py threadsafe
      integer(c_int), intent(in) :: nx8, ny8, nx4, ny4, ns, nbx, nby
      real(c_double), intent(in), target :: z8(nx8, ny8)
      real(c_float), intent(in), target :: z4(nx4, ny4)
      real(c_double), intent(in) :: west, north, cell
      integer(c_int), intent(in) :: nodes(2), at(2)
      real(c_double), intent(in) :: source_x(ns), source_y(ns), drop_height, velocity(3), gravity
      integer(c_int), intent(in) :: first, last
      real(c_double), intent(inout) :: minima(nbx, nby), head(1)
      integer(c_int), intent(out) :: code
      character(len=1024), intent(out) :: message
      type(scene_t) :: scene
      type(error_t), allocatable :: error

      call set_terrain(scene%dem, z8, z4, west, north, cell, nodes, at)
      scene%gravity = gravity
      scene%release%drop_height = drop_height
      scene%release%velocity = velocity
      call set_sources(scene, source_x, source_y)
      call check_sources(scene, first, last, head(1), error)
      call give_error(error, code, message)
      if (code == 0 .and. size(minima) > 1) call take_minima(scene%dem, first, last, minima)
   end subroutine survey

   !> The first column and row and the last column and row, from 1, of the cells that boulders can reach.
   subroutine reach(nodes, west, north, cell, source_x, source_y, minima, head, box, ns, nbx, nby)
      !f2py threadsafe
      integer(c_int), intent(in) :: ns, nbx, nby
      integer(c_int), intent(in) :: nodes(2)
      real(c_double), intent(in) :: west, north, cell, source_x(ns), source_y(ns), minima(nbx, nby), head
      integer(c_int), intent(out) :: box(4)
      real(c_float), target :: none(1, 1)
      type(terrain_t) :: dem

      none = 0
      dem = terrain(west, north, cell, z4=none, nodes=nodes)
      box = reach_box(dem, minima, head, source_x - dem%x0, source_y - dem%y0)
   end subroutine reach

   !> Cells along a side of a block of cells, of which `survey` takes the least elevation.
   subroutine block_of(nodes, side)
      integer(c_int), intent(in) :: nodes(2)
      integer(c_int), intent(out) :: side

      side = block_side(nodes)
   end subroutine block_of

   !> The tallies that maps need: the places of passages, deposits, sources and their boulders, of the sums,
   !> maxima and first rows of classes of energy, speed and jump height, and the rows of classes; 0 = not wanted.
   subroutine map_plan(names, plan)
      character(len=*), intent(in) :: names  !! of maps, separated by blanks
      integer(c_int), intent(out) :: plan(14)
      type(map_plan_t) :: this
      integer :: k

      this = plan_maps(pack(map_fields, [(index(" "//names//" ", " "//trim(map_fields(k))//" ") > 0, &
                                          k=1, size(map_fields))]))
      plan = [this%count, this%sum, this%max, this%bins, this%rows]
   end subroutine map_plan

   pure type(map_plan_t) function as_plan(plan)
      integer(c_int), intent(in) :: plan(14)

      as_plan = map_plan_t(plan(1:4), plan(5:7), plan(8:10), plan(11:13), plan(14))
   end function as_plan

   pure type(volume_distribution_t) function as_law(law, values, volumes, density)
      integer(c_int), intent(in) :: law
      real(c_double), intent(in) :: values(4), volumes(:), density  !! as in `run`

      as_law%kind = law
      as_law%mean = values(1)
      as_law%std = values(2)
      as_law%min = values(3)
      as_law%max = values(4)
      as_law%list = volumes
      as_law%density = density
   end function as_law

   !> Refuse a run whose maps its tallies cannot hold; `fall` is from the greatest energy head to the lowest
   !> elevation [m], `boulders` those of the whole run.
   subroutine check_tallies(plan, law, law_values, volumes, density, gravity, fall, boulders, code, message, nv)
      integer(c_int), intent(in) :: nv, plan(14), law
      real(c_double), intent(in) :: law_values(4), volumes(nv), density, gravity, fall
      integer(c_int64_t), intent(in) :: boulders
      integer(c_int), intent(out) :: code
      character(len=1024), intent(out) :: message
      type(error_t), allocatable :: error

      call check_map_tallies(as_plan(plan), as_law(law, law_values, volumes, density), gravity, fall, boulders, error)
      call give_error(error, code, message)
   end subroutine check_tallies

   !> A map of reals, of the tallies of `run`; `fewest`: passages for which a cell has a number.
   subroutine map_values(name, boulders, least, plan, map_counts, map_sums, map_reals, class_counts, column, columns, &
                         values, fewest, nxc, nyc, nkc, nxs, nys, nks, nxr, nyr, nkr, kc, cc, nxq, nyq, nx, ny)
      !f2py threadsafe
      integer(c_int), intent(in) :: nxc, nyc, nkc, nxs, nys, nks, nxr, nyr, nkr, kc, cc, nxq, nyq, nx, ny
      character(len=*), intent(in) :: name
      integer(c_int64_t), intent(in) :: boulders
      integer(c_int), intent(in) :: least, plan(14)
      integer(c_int32_t), intent(in), target :: map_counts(nxc, nyc, nkc), class_counts(kc, cc), column(nxq, nyq), &
                                                columns(1)
      integer(c_int64_t), intent(in), target :: map_sums(nxs, nys, nks)
      real(c_float), intent(in), target :: map_reals(nxr, nyr, nkr)
      real(c_float), intent(inout) :: values(nx, ny)
      integer(c_int), intent(out) :: fewest
      type(maps_t) :: maps
      integer :: j

      maps = map_views(as_plan(plan), [1, 1], map_counts, map_sums, map_reals, class_counts, column, columns(1))
      fewest = map_min_count(name, least)
      do j = 1, ny
         call map_row(maps, name, j, boulders, least, values(:, j))
      end do
   end subroutine map_values

   !> The slope from which cells of a size are steep, unless the case says another [degree].
   subroutine slope_threshold(cell, slope)
      real(c_double), intent(in) :: cell  !! [m]
      real(c_double), intent(out) :: slope

      slope = usual_threshold(cell)
   end subroutine slope_threshold

   !> Of the cells above zero in rows `first` (1..) and following, set those to zero that are not steep.
   subroutine steep_cells(z8, z4, nodes, at, cell, threshold, first, cells, nx8, ny8, nx4, ny4, nx, ny)
      !f2py threadsafe
      integer(c_int), intent(in) :: nx8, ny8, nx4, ny4, nx, ny, first, nodes(2), at(2)
      real(c_double), intent(in), target :: z8(nx8, ny8)  !! as in `run`
      real(c_float), intent(in), target :: z4(nx4, ny4)
      real(c_double), intent(in) :: cell, threshold       !! [m], [degree]
      integer(c_int16_t), intent(inout) :: cells(nx, ny)
      type(terrain_t) :: dem

      call set_terrain(dem, z8, z4, 0.0_c_double, 0.0_c_double, cell, nodes, at)
      call keep_steep(dem, threshold, first, cells)
   end subroutine steep_cells

   !> Surface over plan area of the cells of sources, in map coordinates [m].
   subroutine area_ratios(z8, z4, nodes, at, west, north, cell, source_x, source_y, ratio, nx8, ny8, nx4, ny4, ns)
      !f2py threadsafe
      integer(c_int), intent(in) :: nx8, ny8, nx4, ny4, ns, nodes(2), at(2)
      real(c_double), intent(in), target :: z8(nx8, ny8)  !! as in `run`
      real(c_float), intent(in), target :: z4(nx4, ny4)
      real(c_double), intent(in) :: west, north, cell, source_x(ns), source_y(ns)
      real(c_double), intent(out) :: ratio(ns)
      type(scene_t) :: scene

      call set_terrain(scene%dem, z8, z4, west, north, cell, nodes, at)
      call set_sources(scene, source_x, source_y)
      ratio = surface_ratios(scene%dem, scene%release%x, scene%release%y)
   end subroutine area_ratios

   !> The last boulder of each source that releases by area, `boulders` from a flat cell.
   subroutine release_ends(ratio, boulders, last, ns)
      integer(c_int), intent(in) :: ns
      real(c_double), intent(in) :: ratio(ns)
      integer(c_int64_t), intent(in) :: boulders
      integer(c_int64_t), intent(out) :: last(ns)

      last = last_boulders(ratio, boulders)
   end subroutine release_ends

   !> Check the text of a case: code 0, or one line that says what is wrong.
   subroutine check_case(text, name, code, message)
      character(len=*), intent(in) :: text, name
      integer(c_int), intent(out) :: code
      character(len=1024), intent(out) :: message
      type(case_t) :: case
      type(error_t), allocatable :: error

      call read_case(text, name, case, error)
      call give_error(error, code, message)
   end subroutine check_case

   !> Whether a netCDF file claims more than it holds.
   subroutine overstates(file, so)
      character(len=*), intent(in) :: file
      integer(c_int), intent(out) :: so  !! 1 or 0

      so = merge(1, 0, claims_too_much(file))
   end subroutine overstates

   !> Row k of the table of keys: group|key|kind|most|default|allowed|unit|meaning; blank past the end.
   subroutine case_key(k, text)
      integer(c_int), intent(in) :: k
      character(len=512), intent(out) :: text

      text = ""
      if (k >= 1 .and. k <= n_keys) text = key_text(k)
   end subroutine case_key

   !> Row k of the table of result variables: group|name|kind|units|long_name|comment; blank past the end.
   subroutine variable(k, text)
      integer(c_int), intent(in) :: k
      character(len=512), intent(out) :: text

      text = variable_text(k)
   end subroutine variable

   !> The numbers of the five impact sets in a text, as in coefficients_t, for a rule of turning.
   subroutine read_sets(text, name, turning, draw, mean, covariance, incidence, lateral, speed_range, angle_range, &
                        draws, code, message)
      character(len=*), intent(in) :: text, name
      integer(c_int), intent(in) :: turning
      integer(c_int), intent(in) :: draw  !! 0: there must be one only
      real(c_double), intent(out) :: mean(9, 5), covariance(9, 9, 5), incidence(8, 5), lateral(13, 9, 5)
      real(c_double), intent(out) :: speed_range(2, 5), angle_range(2, 5)
      integer(c_int), intent(out) :: draws, code
      character(len=1024), intent(out) :: message
      type(coefficients_t) :: sets
      type(error_t), allocatable :: error

      if (draw > 0) then
         call read_impact_sets(text, name, turning, sets, error, draw, draws)
      else
         draws = 1
         call read_impact_sets(text, name, turning, sets, error)
      end if
      mean = sets%mean
      covariance = sets%covariance
      incidence = sets%incidence
      lateral = sets%lateral
      speed_range = sets%speed_range
      angle_range = sets%angle_range
      call give_error(error, code, message)
   end subroutine read_sets

   !> How often each impact set serves a ratio R_b/R_m.
   subroutine weights_of_sets(ratio, between, weights)
      real(c_double), intent(in) :: ratio
      integer(c_int), intent(in) :: between  !! as in `run`
      real(c_double), intent(out) :: weights(5)

      weights = ratio_weights(ratio, between /= 0)
   end subroutine weights_of_sets

   !> How often method A draws each obstacle size.
   subroutine weights_of_sizes(weights)
      real(c_double), intent(out) :: weights(3)

      weights = size_weights
   end subroutine weights_of_sizes

   !> Names of the rows of `run`: 1 boulder, 2 counts, 3 crossing, 4 vertex; blank past the end.
   subroutine fields(what, text)
      integer(c_int), intent(in) :: what
      character(len=512), intent(out) :: text
      integer :: k

      select case (what)
      case (1); write (text, "(*(a,1x))") (trim(boulder_fields(k)), k=1, size(boulder_fields))
      case (2); write (text, "(*(a,1x))") (trim(boulder_counts(k)), k=1, size(boulder_counts))
      case (3); write (text, "(*(a,1x))") (trim(line_fields(k)), k=1, size(line_fields))
      case (4); write (text, "(*(a,1x))") (trim(vertex_fields(k)), k=1, size(vertex_fields))
      case default; text = ""
      end select
   end subroutine fields

   !> Threads that a run uses when it asks for `threads`.
   subroutine team(threads, size)
      integer(c_int), intent(in) :: threads
      integer(c_int), intent(out) :: size

      size = team_size(threads)
   end subroutine team

   !> Whether the process has room for them: code 0, or one line that says what is wrong.
   subroutine team_fits(threads, code, message)
      integer(c_int), intent(in) :: threads
      integer(c_int), intent(out) :: code
      character(len=1024), intent(out) :: message
      type(error_t), allocatable :: error

      call check_team(threads, error)
      call give_error(error, code, message)
   end subroutine team_fits

   !> Before a fork: a child has none of the threads that wait here, and would wait for them.
   subroutine end_team()
      call release_team()
   end subroutine end_team

   !> Number and width of the bins of each histogram, in the order of rockfall_histogram.
   subroutine histogram_bins(bins, width)
      integer(c_int), intent(out) :: bins(6)
      real(c_double), intent(out) :: width(6)

      bins = n_bins
      width = bin_width
   end subroutine histogram_bins
end module rockfall_f2py
