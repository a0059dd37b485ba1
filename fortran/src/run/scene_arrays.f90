! SPDX-License-Identifier: BSD-3-Clause
!> Arrays of a scene, for both programs: their table, and a component for each array.
module rockfall_scene_arrays
   use, intrinsic :: iso_c_binding, only: c_ptr, c_f_pointer
   use rockfall_kinds, only: wp, sp, i1, i2, i4, i8
   use rockfall_grid, only: grid_t
   use rockfall_table_arrays, only: table_arrays_t
   implicit none
   private
   public :: scene_arrays_t, scene_array_t, scene_table, scene_array_of, scene_array_text, feature_fields, is_borrowed

   !> Attributes of a feature, in the units of the keys with the same names.
   character(len=*), parameter :: feature_fields(*) = [character(len=11) :: "volume_mean", "volume_std", "volume_min", &
                                                       "volume_max", "density", "drop_height", "velocity_x", &
                                                       "velocity_y", "velocity_z"]

   !> Array of a scene, in memory and in scene files.
   type :: scene_array_t
      character(len=16) :: name
      character(len=2) :: kind         !! i1, i4, f4, f8; "": either of two kinds
      character(len=23) :: dimensions  !! as in a file, where the last varies fastest
      character(len=6) :: units
      character(len=124) :: long_name
   end type scene_array_t

   type(scene_array_t), parameter :: scene_table(*) = [ &
      scene_array_t("elevation", "", "y x", "m", "elevation of cell centres"), &
      scene_array_t("zone", "", "y x", "1", "material of the cell, counted from 1; 0: none"), &
      scene_array_t("cell_size", "f4", "size y x", "m", &
                    "mean rock radius, or Rg70, Rg20, Rg10, of the cell; infinite: absorbs"), &
      scene_array_t("material_size", "f8", "material size", "m", &
                    "mean rock radius, or Rg70, Rg20, Rg10; infinite: absorbs"), &
      scene_array_t("source_x", "f8", "source", "m", "easting of the release"), &
      scene_array_t("source_y", "f8", "source", "m", "northing of the release"), &
      scene_array_t("area_ratio", "f8", "source", "1", "ratio of surface to plan area of the source cell"), &
      scene_array_t("source_frequency", "f8", "source", "1/year", "relative frequency of boulders from the source"), &
      scene_array_t("source_feature", "i4", "source", "1", "index of the polygon or point in the layer, from 1"), &
      scene_array_t("feature_law", "i4", "feature", "1", &
                    "volume distribution: fixed, normal, uniform, lognormal; 0: as in the case"), &
      scene_array_t("feature_value", "f8", "feature feature_field", "1", &
                    "mean, std, min, max of volumes, density, drop height, velocity east, north, up"), &
      scene_array_t("source_volume", "f8", "source", "m3", "volume of the boulders of the source"), &
      scene_array_t("source_inertia", "f8", "source", "1", "moment of inertia / (mass x radius squared)"), &
      scene_array_t("source_shape", "i1", "source", "1", &
                    "block shape of its boulders: compact, elongated, platy; 0: as in the case"), &
      scene_array_t("source_density", "f8", "source", "kg/m3", "density of the boulders of the source"), &
      scene_array_t("ground_length", "i4", "ground", "1", &
                    "bytes of the text of each ground; 0: impact sets of the case"), &
      scene_array_t("ground_table", "i4", "ground", "1", "impact table of the ground, counted from 1; 0: none"), &
      scene_array_t("table_shape", "i4", "table table_count", "1", &
                    "numbers of columns, rows, key bins for flights, key bins for rolls, records"), &
      scene_array_t("table_scale", "f8", "table table_number", "1", &
                    "I/(m R_b^2) of the blocks; rest_angle, strength, strength_sigma, strength_radius, "// &
                    "relief, relief_radius, hurst of the ground"), &
      scene_array_t("table_size", "f8", "table_column", "1", &
                    "R_b/R_m, or rho_b g R_b / strength for yielding ground"), &
      scene_array_t("table_relief", "f8", "table_row", "degree", "slope of the relief"), &
      scene_array_t("table_edge", "f8", "table_edges", "1", "edges of the bins"), &
      scene_array_t("table_first", "i4", "table_bin_end", "1", "first record of each bin, counted from 1, and end"), &
      scene_array_t("table_map", "f8", "table_bin map_field", "1", "map of the bin, and range of its inputs"), &
      scene_array_t("table_record", "f4", "contact record_field", "1", "contacts by bin"), &
      scene_array_t("shape_ground", "i4", "block_shape base_ground", "1", &
                    "ground with the table of a block shape, by base ground; both counted from 1"), &
      scene_array_t("material_ground", "i1", "material", "1", "ground of the material, counted from 1"), &
      scene_array_t("cell_ground", "i1", "y x", "1", "ground of the cell, counted from 1; 0: none"), &
      scene_array_t("tree_x", "f8", "tree", "m", "easting of the stem"), &
      scene_array_t("tree_y", "f8", "tree", "m", "northing of the stem"), &
      scene_array_t("tree_dbh", "f8", "tree", "cm", "diameter of the stem at breast height"), &
      scene_array_t("tree_factor", "f8", "tree", "1", "energy that the species absorbs, relative to silver fir")]

   !> Inputs of a scene except its case, from Python or from a scene file. The caller owns the targets of pointers.
   type :: scene_arrays_t
      type(grid_t) :: grid                                       !! grid of the complete raster
      integer :: first(2) = 1                                    !! column and row of the first array element
      real(wp), pointer, contiguous :: z8(:, :) => null()        !! elevations [m] in double precision, or
      real(sp), pointer, contiguous :: z4(:, :) => null()        !! in single precision; NaN = no data
      integer(i1), pointer, contiguous :: zone1(:, :) => null()  !! index of each cell's column in `sizes`, from 1, or
      integer(i2), pointer, contiguous :: zone2(:, :) => null()  !! the same for more than 127 materials
      real(sp), pointer, contiguous :: values(:, :, :) => null() !! or sizes per cell (nx, ny, 1 or 3) [m]
      real(wp), allocatable :: sizes(:, :)                       !! R_m, or Rg70, Rg20, Rg10 (1 or 3, materials) [m]
      real(wp), allocatable :: source_x(:), source_y(:)          !! map coordinates [m]
      real(wp), allocatable :: area_ratio(:)                     !! surface over plan area, if releases need it
      real(wp), allocatable :: source_frequency(:)               !! weights, in any unit, that distribute boulders_total
      real(wp), allocatable :: source_volume(:), source_inertia(:)  !! properties of the boulders, if given [m3], [-]
      real(wp), allocatable :: source_density(:)                 !! density of the boulders, if given [kg/m3]
      integer(i1), allocatable :: source_shape(:)                !! block shape of the boulders; 0: as in the case
      integer, allocatable :: source_feature(:)                  !! feature index, from 1, if sources come from a layer
      integer, allocatable :: feature_distribution(:)            !! volume model (rockfall_boulder); 0: as in the case
      real(wp), allocatable :: feature_value(:, :)               !! (feature_fields, features); NaN: as in the case
      real(wp), pointer, contiguous :: tree_x(:) => null(), tree_y(:) => null()  !! stems, in map coordinates [m]
      real(wp), pointer, contiguous :: tree_dbh(:) => null()     !! stem diameters at breast height, > 0 [cm]
      real(wp), pointer, contiguous :: tree_factor(:) => null()  !! strength factors of the species [-]
      character(len=:), allocatable :: sets_text, sets_name      !! file of impact sets, and its name for messages
      integer :: draw = 0                                        !! index of the draw; 0: the file has only one
      character(len=:), allocatable :: ground_text, ground_names  !! concatenated texts; names, as in parsed_grounds
      integer, allocatable :: ground_length(:)                   !! length of each text, unless only impact sets apply
      integer, allocatable :: ground_table(:)                    !! impact table of each ground, from 1; 0: none
      type(table_arrays_t) :: tables                             !! impact tables
      integer(i1), allocatable :: material_ground(:)             !! index, from 1, of the ground of each material
      integer(i1), pointer, contiguous :: cell_ground(:, :) => null()  !! of each cell instead; default: first ground
      integer, allocatable :: shape_ground(:, :)                 !! as in shape_mix_t, if impact tables differ by shape
   contains
      procedure :: set_array
   end type scene_arrays_t

contains

   !> Row of the table for an array name, which must exist.
   pure type(scene_array_t) function scene_array_of(name) result(row)
      character(len=*), intent(in) :: name

      row = scene_table(findloc(scene_table%name == name, .true., dim=1))
   end function scene_array_of

   !> Row k of the table as text, "name|kind|dimensions|units|long name"; blank past the end.
   pure function scene_array_text(k) result(text)
      integer, intent(in) :: k
      character(len=:), allocatable :: text
      type(scene_array_t) :: row

      text = ""
      if (k < 1 .or. k > size(scene_table)) return
      row = scene_table(k)
      text = trim(row%name)//"|"//trim(row%kind)//"|"//trim(row%dimensions)//"|"//trim(row%units)//"|" &
             //trim(row%long_name)
   end function scene_array_text

   !> Set a component, by its name in scene files, to a contiguous array in memory; the kind selects the component for
   !> elevations and zones. Rasters and trees stay in the caller's memory; other arrays are copied.
   subroutine set_array(arrays, name, kind, length, at)
      class(scene_arrays_t), intent(inout) :: arrays
      character(len=*), intent(in) :: name, kind  !! kind: i1, i2, i4, f4, f8
      integer(i8), intent(in) :: length(3)        !! dimensions, the first varies fastest; 1 beyond the last
      type(c_ptr), intent(in) :: at
      real(wp), pointer, contiguous :: reals(:), table(:, :)
      integer(i4), pointer, contiguous :: integers(:), numbers(:, :)
      integer(i1), pointer, contiguous :: bytes(:)

      call c_f_pointer(at, reals, length(:1))
      call c_f_pointer(at, table, length(:2))
      call c_f_pointer(at, integers, length(:1))
      call c_f_pointer(at, numbers, length(:2))
      call c_f_pointer(at, bytes, length(:1))
      select case (name)
      case ("elevation")
         if (kind == "f8") call c_f_pointer(at, arrays%z8, length(:2))
         if (kind == "f4") call c_f_pointer(at, arrays%z4, length(:2))
      case ("zone")
         if (kind == "i1") call c_f_pointer(at, arrays%zone1, length(:2))
         if (kind == "i2") call c_f_pointer(at, arrays%zone2, length(:2))
      case ("cell_size"); call c_f_pointer(at, arrays%values, length)
      case ("material_size"); arrays%sizes = table
      case ("source_x"); arrays%source_x = reals
      case ("source_y"); arrays%source_y = reals
      case ("area_ratio"); arrays%area_ratio = reals
      case ("source_frequency"); arrays%source_frequency = reals
      case ("source_volume"); arrays%source_volume = reals
      case ("source_inertia"); arrays%source_inertia = reals
      case ("source_density"); arrays%source_density = reals
      case ("source_shape"); arrays%source_shape = bytes
      case ("source_feature"); arrays%source_feature = integers
      case ("feature_law"); arrays%feature_distribution = integers
      case ("feature_value"); arrays%feature_value = table
      case ("tree_x"); arrays%tree_x => reals
      case ("tree_y"); arrays%tree_y => reals
      case ("tree_dbh"); arrays%tree_dbh => reals
      case ("tree_factor"); arrays%tree_factor => reals
      case ("impact_sets"); arrays%sets_text = text_of(bytes)
      case ("impact_sets_file"); arrays%sets_name = text_of(bytes)
      case ("ground_length"); arrays%ground_length = integers
      case ("ground_table"); arrays%ground_table = integers
      case ("table_shape"); arrays%tables%shape => numbers
      case ("table_scale"); arrays%tables%scale => table
      case ("table_size"); arrays%tables%size => reals
      case ("table_relief"); arrays%tables%relief => reals
      case ("table_edge"); arrays%tables%edge => reals
      case ("table_first"); arrays%tables%first => integers
      case ("table_map"); arrays%tables%map => table
      case ("table_record"); call c_f_pointer(at, arrays%tables%record, length(:2))
      case ("ground_text"); arrays%ground_text = text_of(bytes)
      case ("ground_names"); arrays%ground_names = text_of(bytes)
      case ("material_ground"); arrays%material_ground = bytes
      case ("shape_ground"); arrays%shape_ground = numbers
      case ("cell_ground"); call c_f_pointer(at, arrays%cell_ground, length(:2))
      end select
   end subroutine set_array

   !> Return whether an array with this name stays in the caller's memory.
   pure logical function is_borrowed(name)
      character(len=*), intent(in) :: name

      is_borrowed = any(name == [character(len=11) :: "elevation", "zone", "cell_size", "cell_ground"]) &
                    .or. index(name, "tree_") == 1 .or. index(name, "table_") == 1
   end function is_borrowed

   pure function text_of(bytes) result(text)
      integer(i1), intent(in) :: bytes(:)
      character(len=size(bytes)) :: text

      text = transfer(bytes, text)
   end function text_of
end module rockfall_scene_arrays
