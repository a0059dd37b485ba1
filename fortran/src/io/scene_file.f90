! SPDX-License-Identifier: BSD-3-Clause
!> Scene file, written by `rockfall prepare` or another tool (docs/files.md): all input of a scene except its case.
!> Validates everything the kernel relies on.
module rockfall_scene_file
   use, intrinsic :: iso_c_binding, only: c_loc, c_f_pointer
   use, intrinsic :: ieee_arithmetic, only: ieee_is_nan, ieee_is_finite
   use netcdf, only: nf90_global, nf90_inq_varid, nf90_noerr, nf90_char, nf90_byte, nf90_short, nf90_int, nf90_float, &
                     nf90_double
   use rockfall_kinds, only: wp, i1, i2, i8
   use rockfall_error, only: error_t, fail
   use rockfall_text, only: integer_text, max_text
   use rockfall_netcdf_file, only: netcdf_file_t, axis_t, definition_t, open_netcdf, record_status, is_ok, &
                                   mark_damaged, fail_damaged, check_shape, transfer, length_of, kind_of, text_of, &
                                   integers_of
   use rockfall_system, only: end_reading
   use rockfall_terrain, only: max_elevation
   use rockfall_dimensions, only: n_block_shapes
   use rockfall_surface, only: method_a
   use rockfall_boulder, only: list_volume
   use rockfall_variables, only: layout => scene_layout
   use rockfall_case_keys, only: max_real
   use rockfall_case, only: case_t
   use rockfall_namelist, only: namelist_t
   use rockfall_same_run, only: differing_key, keys_of
   use rockfall_scene_type, only: scene_t
   use rockfall_grounds, only: max_grounds
   use rockfall_scene_arrays, only: scene_arrays_t, scene_array_t, scene_array_of, feature_fields, is_borrowed
   use rockfall_scene, only: build_scene_of_case
   implicit none
   private
   public :: inputs_t, read_scene

   !> Scene and the input from which it was built. Arrays that it refers to stay in memory.
   type :: inputs_t
      type(scene_t) :: scene
      type(scene_arrays_t) :: arrays
      type(namelist_t) :: keys
      type(netcdf_file_t) :: file              !! open file, whose `crs` is copied to results
      integer :: crs = -1                      !! id of the variable `crs`
      type(axis_t) :: cells(2)                 !! x, y
      integer :: sizes = 1                     !! number of rock sizes per material; 3 for method A
      character(len=:), allocatable :: case_file, impact_set_checksum, input_checksums, decoded_checksums
      character(len=:), allocatable :: feature_names  !! features in the source layer, one line each
      !> JSON for the result; "" if the file has none.
      character(len=:), allocatable :: input_warnings, lines_beyond, dams, stands
   end type inputs_t

contains

   !> Read the scene of a case from the prepared file.
   subroutine read_scene(name, case, keys, inputs, error)
      character(len=*), intent(in) :: name
      type(case_t), intent(in) :: case
      type(namelist_t), intent(in) :: keys
      type(inputs_t), intent(out) :: inputs
      type(error_t), allocatable, intent(out) :: error

      call open_netcdf(name, inputs%file, error)
      inputs%keys = keys
      if (.not. allocated(error)) call check_case(inputs, case, error)
      if (allocated(error)) return
      call read_place(inputs)
      call read_elevations(inputs)
      call read_grounds(inputs)
      call read_surface(inputs, case)
      call read_sources(inputs, case)
      if (case%forest) call read_trees(inputs)
      call read_letters(inputs%file, "impact_sets", inputs%arrays%sets_text, inputs%arrays%sets_name, "file")
      call end_reading()
      if (.not. is_ok(inputs%file)) then
         call fail_damaged(inputs%file, error)
         error%message = error%message//" is missing or malformed"
         return
      end if
      call build_scene_of_case(case, inputs%arrays, inputs%scene, error)
   end subroutine read_scene

   !> Check that the file is a scene file prepared for this case.
   subroutine check_case(inputs, case, error)
      type(inputs_t), intent(inout) :: inputs
      type(case_t), intent(in) :: case
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: key

      associate (file => inputs%file)
         if (any(integers_of(file, "scene_layout", 1) /= layout)) then
            call fail(error, file%name//": is not a scene file with layout "//integer_text(layout)// &
                      ": create it with `rockfall prepare`")
            return
         end if
         key = differing_key(keys_of(text_of(file, nf90_global, "case")), inputs%keys, of_arrays=.true.)
         if (key /= "") call fail(error, case%file//": "//key//": differs from the case of "//file%name// &
                                  ": run `rockfall prepare` again")
         inputs%case_file = text_of(file, nf90_global, "case_file")
         inputs%feature_names = ""
         inputs%input_warnings = text_of(file, nf90_global, "input_warnings")
         inputs%lines_beyond = text_of(file, nf90_global, "lines_beyond")
         inputs%dams = text_of(file, nf90_global, "dams")
         inputs%stands = text_of(file, nf90_global, "stands")
         inputs%impact_set_checksum = text_of(file, nf90_global, "impact_set_checksum")
         inputs%input_checksums = text_of(file, nf90_global, "input_checksums")
         inputs%decoded_checksums = text_of(file, nf90_global, "decoded_checksums")
         if (.not. (is_object(inputs%input_checksums) .and. is_object(inputs%decoded_checksums))) &
            call mark_damaged(file, "its checksums")
      end associate
   end subroutine check_case

   !> Return whether a text may be a JSON object.
   pure logical function is_object(text)
      character(len=*), intent(in) :: text

      is_object = len(text) >= 2
      if (is_object) is_object = text(1:1) == "{" .and. text(len(text):) == "}"
   end function is_object

   !> Read the position of the raster: the GeoTransform of its grid mapping.
   subroutine read_place(inputs)
      type(inputs_t), intent(inout) :: inputs
      character(len=:), allocatable :: text
      real(wp) :: places(6)
      integer :: status
      logical :: good

      associate (file => inputs%file, grid => inputs%arrays%grid)
         grid%nx = length_of(file, "x")
         grid%ny = length_of(file, "y")
         if (min(grid%nx, grid%ny) < 2) call mark_damaged(file, "its number of cells")
         inputs%cells = [axis_t("x", int(grid%nx, i8)), axis_t("y", int(grid%ny, i8))]
         places = 0
         text = ""
         status = nf90_inq_varid(file%id, "crs", inputs%crs)
         if (status == nf90_noerr) then
            text = text_of(file, inputs%crs, "GeoTransform")
            read (text, *, iostat=status) places
         end if
         good = status == 0 .and. all(is_place(places)) .and. scan(text, ",;/*'""dD") == 0
         if (good) good = places(2) > 0 .and. all(abs(places([3, 5])) <= 0) .and. abs(places(2) + places(6)) <= 0
         if (.not. good) call mark_damaged(file, "the GeoTransform of crs")
         grid%west = places(1)
         grid%north = places(4)
         grid%cell = places(2)
      end associate
   end subroutine read_place

   !> Return whether a coordinate is within the range allowed in a case.
   elemental logical function is_place(value)
      real(wp), intent(in) :: value  !! [m]

      is_place = ieee_is_finite(value)
      if (is_place) is_place = abs(value) <= max_real
   end function is_place

   !> Read elevations in the precision of the file; at least one must exist.
   subroutine read_elevations(inputs)
      type(inputs_t), intent(inout) :: inputs
      integer :: j
      logical :: any_known, good

      associate (file => inputs%file, ny => inputs%arrays%grid%ny)
         call take(inputs, "elevation")
         if (.not. is_ok(file)) return
         any_known = .false.
         good = .true.
         do j = 1, ny
            associate (here => is_known(inputs, j))
               any_known = any_known .or. any(here)
               good = good .and. all(abs(merge(row_of(inputs, j), 0.0_wp, here)) <= max_elevation)
            end associate
         end do
         if (.not. (any_known .and. good)) call mark_damaged(file, "elevation")
      end associate
   end subroutine read_elevations

   !> Read an array of the table of arrays, and pass it to the scene.
   subroutine take(inputs, name, positive)
      type(inputs_t), intent(inout) :: inputs
      character(len=*), intent(in) :: name
      logical, intent(in), optional :: positive  !! reals must be positive
      real(wp), pointer, contiguous :: values(:)
      integer, parameter :: kinds(*) = [nf90_byte, nf90_short, nf90_int, nf90_float, nf90_double]
      integer, parameter :: width(*) = [1, 2, 4, 4, 8]
      integer(i1), pointer, contiguous :: block(:)
      type(scene_array_t) :: row
      type(definition_t) :: definition
      type(axis_t), allocatable :: axes(:)
      integer(i8) :: length(3)
      integer :: k, status

      row = scene_array_of(name)
      if (name == "elevation") row%kind = merge("f4", "f8", kind_of(inputs%file, name) == nf90_float)
      if (name == "zone") row%kind = merge("i2", "i1", length_of(inputs%file, "material") > huge(1_i1))
      k = findloc(["i1", "i2", "i4", "f4", "f8"], row%kind, dim=1)
      definition = definition_t(name, kinds(k))
      axes = axes_of(inputs, row%dimensions)
      call check_shape(inputs%file, definition, axes)
      if (.not. is_ok(inputs%file)) return
      length = 1
      length(:size(axes)) = axes%length
      allocate (block(width(k)*product(length)), stat=status)
      if (status /= 0) call mark_damaged(inputs%file, "(no memory) "//name)
      call transfer(inputs%file, definition, axes, block)
      if (.not. is_ok(inputs%file)) return
      if (present(positive)) then
         call c_f_pointer(c_loc(block), values, length(:1))
         if (.not. all(is_place(values) .and. above_zero(values))) call mark_damaged(inputs%file, name)
      end if
      call inputs%arrays%set_array(name, row%kind, length, c_loc(block))
      if (.not. is_borrowed(name)) deallocate (block)
   end subroutine take

   !> Axes of an array, fastest first, with the lengths expected by the kernel or found in the file.
   function axes_of(inputs, dimensions) result(axes)
      type(inputs_t), intent(in) :: inputs
      character(len=*), intent(in) :: dimensions
      type(axis_t), allocatable :: axes(:)
      type(axis_t) :: axis
      integer :: first, last

      allocate (axes(0))
      last = len_trim(dimensions)
      do while (last > 0)
         first = index(dimensions(:last), " ", back=.true.) + 1
         axis%name = dimensions(first:last)
         select case (axis%name)
         case ("size"); axis%length = inputs%sizes
         case ("block_shape"); axis%length = n_block_shapes
         case ("feature_field"); axis%length = size(feature_fields)
         case ("material"); axis%length = max(1, length_of(inputs%file, "material"))
         case default; axis%length = length_of(inputs%file, trim(axis%name))
         end select
         axes = [axes, axis]
         last = first - 2
      end do
   end function axes_of

   !> Elevations of a row; NaN where there is no data.
   pure function row_of(inputs, j) result(z)
      type(inputs_t), intent(in) :: inputs
      integer, intent(in) :: j
      real(wp) :: z(inputs%arrays%grid%nx)

      if (associated(inputs%arrays%z4)) then
         z = inputs%arrays%z4(:, j)
      else
         z = inputs%arrays%z8(:, j)
      end if
   end function row_of

   pure function is_known(inputs, j) result(mask)
      type(inputs_t), intent(in) :: inputs
      integer, intent(in) :: j
      logical :: mask(inputs%arrays%grid%nx)

      mask = .not. ieee_is_nan(row_of(inputs, j))
   end function is_known

   !> Read ground types: one everywhere, or by material or cell; none if only the case's impact sets apply.
   subroutine read_grounds(inputs)
      type(inputs_t), intent(inout) :: inputs
      integer, allocatable :: index(:)
      integer :: n, j

      associate (file => inputs%file, arrays => inputs%arrays)
         if (kind_of(file, "ground_length") == 0) return
         n = length_of(file, "ground")
         if (n < 1 .or. n > n_block_shapes*max_grounds) call mark_damaged(file, "its number of grounds")
         if (.not. is_ok(file)) return
         call take(inputs, "ground_length")
         if (is_ok(file)) call take_texts(inputs)
         if (kind_of(file, "ground_table") /= 0 .and. is_ok(file)) call read_tables(inputs)
         if (.not. is_ok(file)) return
         if (kind_of(file, "shape_ground") /= 0 .and. is_ok(file)) then
            call read_shape_grounds(inputs, n)
            if (.not. is_ok(file)) return
            n = size(arrays%shape_ground, 1)
         end if
         if (kind_of(file, "material_ground") /= 0 .and. is_ok(file)) then
            call take(inputs, "material_ground")
            if (.not. is_ok(file)) return
            if (any(arrays%material_ground < 1 .or. arrays%material_ground > n)) call mark_damaged(file, &
               "material_ground")
         end if
         if (kind_of(file, "cell_ground") == 0 .or. .not. is_ok(file)) return
         call take(inputs, "cell_ground")
         if (.not. is_ok(file)) return
         do j = 1, arrays%grid%ny
            index = arrays%cell_ground(:, j)
            if (any(is_known(inputs, j) .and. (index < 1 .or. index > n))) call mark_damaged(file, "cell_ground")
         end do
      end associate
   end subroutine read_grounds

   !> Read the impact tables of the grounds; their arrays are checked together with the scene.
   subroutine read_tables(inputs)
      type(inputs_t), intent(inout) :: inputs

      call take(inputs, "ground_table")
      call take(inputs, "table_shape")
      call take(inputs, "table_scale")
      call take(inputs, "table_size")
      call take(inputs, "table_relief")
      if (kind_of(inputs%file, "table_edge") /= 0) call take(inputs, "table_edge")
      call take(inputs, "table_first")
      call take(inputs, "table_map")
      call take(inputs, "table_record")
   end subroutine read_tables

   !> Read the ground for each shape on each cell ground; cell grounds are the first of all `n` grounds.
   subroutine read_shape_grounds(inputs, n)
      type(inputs_t), intent(inout) :: inputs
      integer, intent(in) :: n
      integer :: of_cells

      associate (file => inputs%file, arrays => inputs%arrays)
         of_cells = length_of(file, "base_ground")
         if (of_cells < 1 .or. of_cells > min(n, max_grounds)) call mark_damaged(file, "shape_ground")
         if (.not. is_ok(file)) return
         call take(inputs, "shape_ground")
         if (.not. is_ok(file)) return
         if (any(arrays%shape_ground < 1 .or. arrays%shape_ground > n)) call mark_damaged(file, "shape_ground")
      end associate
   end subroutine read_shape_grounds

   !> Read the texts of the grounds, which the file concatenates, with their names.
   subroutine take_texts(inputs)
      type(inputs_t), intent(inout) :: inputs

      associate (file => inputs%file, arrays => inputs%arrays, length => inputs%arrays%ground_length)
         call read_letters(file, "ground_text", arrays%ground_text, arrays%ground_names, "names")
         if (.not. is_ok(file)) return
         if (any(length < 0) .or. sum(int(length, i8)) /= len(arrays%ground_text)) &
            call mark_damaged(file, "ground_length")
      end associate
   end subroutine take_texts

   !> Read the surface: zones and their sizes, sizes per cell, or one size. On known terrain, sizes must be positive
   !> (infinite means absorbing); zero is allowed if some ground has no rocks.
   subroutine read_surface(inputs, case)
      type(inputs_t), intent(inout) :: inputs
      type(case_t), intent(in) :: case
      integer :: materials

      inputs%sizes = merge(3, 1, case%method == method_a)
      associate (file => inputs%file, arrays => inputs%arrays)
         materials = max(1, length_of(file, "material"))
         if (materials > huge(1_i2)) call mark_damaged(file, "its number of materials")
         if (.not. is_ok(file)) return
         if (kind_of(file, "cell_size") /= 0) then
            allocate (arrays%sizes(inputs%sizes, materials), source=0.0_wp)
            call take(inputs, "cell_size")
            if (is_ok(file)) call check_values(inputs)
         else
            call take(inputs, "material_size")
            if (.not. is_ok(file)) return
            if (kind_of(file, "zone") /= 0) then
               call read_zones(inputs, materials)
            else if (materials /= 1 .or. .not. all(is_size(inputs, arrays%sizes))) then
               call mark_damaged(file, "material_size")
            end if
         end if
      end associate
   end subroutine read_surface

   !> Return whether a value is a valid rock size.
   impure elemental logical function is_size(inputs, value)
      type(inputs_t), intent(in) :: inputs
      real(wp), intent(in) :: value  !! [m]

      is_size = above_zero(value)
      if (allocated(inputs%arrays%ground_length) .and. .not. ieee_is_nan(value)) is_size = value >= 0
   end function is_size

   !> Return whether a value is positive; safe for NaN, whose comparison could raise a trapped exception.
   elemental logical function above_zero(value)
      real(wp), intent(in) :: value

      above_zero = .not. ieee_is_nan(value)
      if (above_zero) above_zero = value > 0
   end function above_zero

   subroutine read_zones(inputs, materials)
      type(inputs_t), intent(inout) :: inputs
      integer, intent(in) :: materials
      integer :: j
      integer :: zone(inputs%arrays%grid%nx)
      logical :: good(0:materials), here(inputs%arrays%grid%nx)

      associate (file => inputs%file, arrays => inputs%arrays)
         call take(inputs, "zone")
         if (.not. is_ok(file)) return
         good(0) = .false.
         good(1:) = [(all(is_size(inputs, arrays%sizes(:, j))), j=1, materials)]
         do j = 1, arrays%grid%ny
            if (associated(arrays%zone1)) zone = arrays%zone1(:, j)
            if (associated(arrays%zone2)) zone = arrays%zone2(:, j)
            here = is_known(inputs, j)
            if (any(zone < 0 .or. zone > materials)) call mark_damaged(file, "zone")
            if (.not. is_ok(file)) return
            if (any(here .and. .not. good(zone))) call mark_damaged(file, "zone, or the material_size of one,")
         end do
      end associate
   end subroutine read_zones

   subroutine check_values(inputs)
      type(inputs_t), intent(inout) :: inputs
      integer :: j, k

      do k = 1, inputs%sizes
         do j = 1, inputs%arrays%grid%ny
            if (any(is_known(inputs, j) .and. .not. is_size(inputs, real(inputs%arrays%values(:, j, k), wp)))) &
               call mark_damaged(inputs%file, "cell_size")
         end do
      end do
   end subroutine check_values

   subroutine read_sources(inputs, case)
      type(inputs_t), intent(inout) :: inputs
      type(case_t), intent(in) :: case

      associate (file => inputs%file, arrays => inputs%arrays)
         if (length_of(file, "source") < 1) call mark_damaged(file, "its number of sources")
         call take(inputs, "source_x")
         call take(inputs, "source_y")
         if (.not. is_ok(file)) return
         if (.not. all(is_place(arrays%source_x) .and. is_place(arrays%source_y))) &
            call mark_damaged(file, "source_x, or source_y,")
         if (case%by_source) call take(inputs, "source_volume", positive=.true.)
         if (case%by_source) call take(inputs, "source_inertia", positive=.true.)
         if (case%source_density) call take(inputs, "source_density", positive=.true.)
         if (case%by_area) call take(inputs, "area_ratio", positive=.true.)
         if (kind_of(file, "source_frequency") /= 0) &
            call take(inputs, "source_frequency", positive=.true.)
         if (kind_of(file, "source_shape") /= 0) call take(inputs, "source_shape")
         if (.not. (sum(case%shape_share) > 0 .or. allocated(arrays%source_shape))) call mark_damaged(file, &
            "source_shape")
         if (allocated(arrays%source_shape)) then
            if (any(arrays%source_shape < 0 .or. arrays%source_shape > n_block_shapes)) &
               call mark_damaged(file, "source_shape")
         end if
         if (kind_of(file, "source_feature") /= 0) call read_features(inputs)
      end associate
   end subroutine read_sources

   !> Read the feature of each source, and the attributes of the features.
   subroutine read_features(inputs)
      type(inputs_t), intent(inout) :: inputs
      integer :: n

      associate (file => inputs%file, arrays => inputs%arrays)
         if (.not. is_ok(file)) return
         inputs%feature_names = text_of(file, nf90_global, "source_features")
         n = length_of(file, "feature")
         if (kind_of(file, "feature_law") == 0) n = huge(1)
         if (n < 1) call mark_damaged(file, "its number of features")
         if (.not. is_ok(file)) return
         call take(inputs, "source_feature")
         if (.not. is_ok(file)) return
         if (any(arrays%source_feature < 1 .or. arrays%source_feature > n)) call mark_damaged(file, "source_feature")
         if (kind_of(file, "feature_law") == 0 .or. .not. is_ok(file)) return
         call take(inputs, "feature_law")
         call take(inputs, "feature_value")
         if (.not. is_ok(file)) return
         if (any(arrays%feature_distribution < 0 &
                 .or. arrays%feature_distribution > list_volume)) call mark_damaged(file, "feature_law")
         associate (value => arrays%feature_value)
            value = merge(value, -1.0_wp, is_place(value) .or. ieee_is_nan(value))
            if (any(above_zero(-value(:6, :)))) call mark_damaged(file, "feature_value")
         end associate
      end associate
   end subroutine read_features

   !> Read trees; their diameters and factors are positive.
   subroutine read_trees(inputs)
      type(inputs_t), intent(inout) :: inputs

      associate (file => inputs%file, arrays => inputs%arrays)
         if (length_of(file, "tree") < 1) call mark_damaged(file, "its number of trees")
         call take(inputs, "tree_x")
         call take(inputs, "tree_y")
         call take(inputs, "tree_dbh", positive=.true.)
         call take(inputs, "tree_factor", positive=.true.)
         if (.not. is_ok(file)) return
         if (.not. all(is_place(arrays%tree_x) .and. is_place(arrays%tree_y))) &
            call mark_damaged(file, "tree_x, or tree_y,")
      end associate
   end subroutine read_trees

   !> Read a text of any length, stored one letter per element, and one of its attributes.
   subroutine read_letters(file, name, text, attribute, attribute_name)
      type(netcdf_file_t), intent(inout) :: file
      character(len=*), intent(in) :: name
      character(len=:), allocatable, intent(out) :: text, attribute
      character(len=*), intent(in) :: attribute_name
      character(len=1), allocatable :: letter(:)
      integer :: id, n, k

      n = max(0, length_of(file, name//"_length"))
      if (.not. is_ok(file)) return
      if (n > max_text) call mark_damaged(file, name)
      if (.not. is_ok(file)) return
      allocate (letter(n))
      call transfer(file, definition_t(name, nf90_char), [axis_t(name//"_length", int(n, i8))], letter)
      allocate (character(len=n) :: text)
      do k = 1, n
         text(k:k) = letter(k)
      end do
      call record_status(file, nf90_inq_varid(file%id, name, id))
      attribute = text_of(file, id, attribute_name)
   end subroutine read_letters

end module rockfall_scene_file
