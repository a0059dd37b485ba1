! SPDX-License-Identifier: BSD-3-Clause
!> Refusal of keys that would have no effect, with a message about the feature they require. A key may always have its
!> default, because a program that writes a case may write all keys.
module rockfall_case_effects
   use rockfall_error, only: error_t, gather
   use rockfall_namelist, only: namelist_t, group_t, parse_namelist
   use rockfall_values, only: has_key, text_of, get_text, refuse
   use rockfall_case_keys, only: key_table, n_keys, map_names, plain
   implicit none
   private
   public :: check_effects, mark_defaults

   integer, parameter :: key_length = len(key_table%name), map_length = len(map_names)

contains

   !> Refuse keys of a complete case that no program would use; the error lists the first of each group.
   pure subroutine check_effects(list, error)
      type(namelist_t), intent(in) :: list
      type(error_t), allocatable, intent(out) :: error
      type(error_t), allocatable :: fault
      integer :: g

      do g = 1, size(list%group)
         select case (list%group(g)%name)
         case ("surface"); call check_surface(list, list%group(g), fault)
         case ("impact"); call check_impact(list, list%group(g), fault)
         case ("boulder"); call check_boulder(list, list%group(g), fault)
         case ("breakage"); call check_breakage(list%group(g), fault)
         case ("forest"); call check_forest(list%group(g), fault)
         case ("output"); call check_output(list%group(g), fault)
         case ("hazard"); call check_hazard(list, list%group(g), fault)
         end select
         call gather(fault, error)
      end do
   end subroutine check_effects

   !> Mark keys that have their default, whether written or not, except in groups whose layer may give values. The form
   !> of rebounds is not marked if a table is named, because the table has its own default.
   pure subroutine mark_defaults(list)
      type(namelist_t), intent(inout) :: list
      integer :: e, g

      do g = 1, size(list%group)
         associate (group => list%group(g))
            if (has_key(group, "file")) cycle
            do e = 1, size(group%entry)
               associate (key => group%entry(e)%key, given => group%entry(e)%given)
                  if (given) given = is_changed(group, trim(key))
                  if (group%name == "impact" .and. key == "form") &
                     given = is_changed(group, "form") .or. is_changed(group, "table")
               end associate
            end do
         end associate
      end do
   end subroutine mark_defaults

   !> Check the keys of &surface; rock sizes are allowed for both methods, because `rockfall models` compares them.
   pure subroutine check_surface(list, group, error)
      type(namelist_t), intent(in) :: list
      type(group_t), intent(in) :: group
      type(error_t), allocatable, intent(out) :: error
      logical :: sizes

      sizes = text_of(group, "method") == "A" .or. has_key(group, "rg70") .or. has_key(group, "uniform_rg")
      call only_with(group, ["zone_field"], has_key(group, "zones"), "zones", error)
      call only_with(group, ["rg_reading"], sizes .or. has_grounds(group), "method = 'A', or a ground", error)
      call only_with(group, ["ground_table"], has_grounds(group), "ground, ground_map or zones", error)
      call only_with(group, [character(len=key_length) :: "ground_strength", "ground_relief"], &
                     has_key(group, "ground") .or. by_table(list), "ground, or &impact table", error)
   end subroutine check_surface

   pure subroutine check_impact(list, group, error)
      type(namelist_t), intent(in) :: list
      type(group_t), intent(in) :: group
      type(error_t), allocatable, intent(out) :: error

      call only_with(group, [character(len=key_length) :: "ratio", "turning"], &
                     text_of(group, "form") == "matrix" .or. any_grounds(list), "form = 'matrix', or a ground", &
                     error)
   end subroutine check_impact

   pure subroutine check_boulder(list, group, error)
      type(namelist_t), intent(in) :: list
      type(group_t), intent(in) :: group
      type(error_t), allocatable, intent(out) :: error

      call only_with(group, [character(len=key_length) :: "block_shape", "block_shape_share", "block_axes", &
                            "ground_strength_sigma"], by_table(list) .or. any_grounds(list), &
                     "an impact table: &impact form = 'table', or a ground", error)
      call only_with(group, ["mean_radius_sigma"], any_rocks(list), "rock sizes in &surface", error)
      if (has_key(group, "rock_density") .and. is_changed(group, "density") .and. .not. allocated(error)) &
         call refuse(group, "density", "is not valid together with rock_density, which gives it", error)
   end subroutine check_boulder

   pure subroutine check_breakage(group, error)
      type(group_t), intent(in) :: group
      type(error_t), allocatable, intent(out) :: error

      call only_with(group, [character(len=key_length) :: "min_area_ratio", "min_volume", "max_fragments", "cone"], &
                     text_of(group, "at") /= "none", "at = 'release', 'impact' or 'both'", error)
   end subroutine check_breakage

   pure subroutine check_forest(group, error)
      type(group_t), intent(in) :: group
      type(error_t), allocatable, intent(out) :: error
      logical :: listed, made, stands

      listed = has_key(group, "trees")
      made = has_key(group, "stems") .or. has_key(group, "uniform_stems")
      stands = has_key(group, "polygons")
      call only_with(group, [character(len=key_length) :: "seed", "clear_of_sources", "density_factor", &
                             "lateral_from", "scratch_from", "turn_frontal", "turn_lateral", "turn_scratch"], &
                     listed .or. made .or. stands, "trees, polygons or stems", error)
      call only_with(group, [character(len=key_length) :: "dbh_field", "species_field"], listed, "trees", error)
      call only_with(group, ["spread"], made .or. stands, "polygons or stems", error)
   end subroutine check_forest

   pure subroutine check_output(group, error)
      type(group_t), intent(in) :: group
      type(error_t), allocatable, intent(out) :: error

      call only_with(group, [character(len=key_length) :: "map_extent", "min_passages"], has_key(group, "maps"), &
                     "maps", error)
   end subroutine check_output

   !> Check the keys of &hazard: thresholds and object width are also valid with maps that use them, without scenarios.
   pure subroutine check_hazard(list, group, error)
      type(namelist_t), intent(in) :: list
      type(group_t), intent(in) :: group
      type(error_t), allocatable, intent(out) :: error
      logical :: scenarios

      scenarios = any(list%group%name == "scenario")
      call only_with(group, [character(len=key_length) :: "return_periods", "matrix", "frequency_factor", &
                             "minimum_area", "minimum_width"], scenarios, "&scenario", error)
      call only_with(group, ["object_width"], scenarios .or. has_maps(list, "hits"), "&scenario, or hit maps", &
                     error)
      call only_with(group, ["thresholds"], scenarios .or. has_maps(list, "exceeded"), &
                     "&scenario, or maps ..._exceeded", error)
   end subroutine check_hazard

   !> Refuse the first of `keys` that differs from its default, unless `valid`.
   pure subroutine only_with(group, keys, valid, with, error)
      type(group_t), intent(in) :: group
      character(len=*), intent(in) :: keys(:), with
      logical, intent(in) :: valid
      type(error_t), allocatable, intent(inout) :: error
      integer :: k

      if (valid .or. allocated(error)) return
      do k = 1, size(keys)
         if (.not. is_changed(group, trim(keys(k)))) cycle
         call refuse(group, trim(keys(k)), "is only valid with "//with, error)
         return
      end do
   end subroutine only_with

   !> Return whether the values of a key differ from its default, or are given although the key has no default.
   pure logical function is_changed(group, key)
      type(group_t), intent(in) :: group
      character(len=*), intent(in) :: key
      character(len=:), allocatable :: default
      type(namelist_t) :: usual
      type(error_t), allocatable :: error
      integer :: e, k

      is_changed = .false.
      do e = 1, size(group%entry)
         if (group%entry(e)%key == key) exit
      end do
      if (e > size(group%entry)) return
      do k = 1, n_keys
         if (key_table(k)%group == group%name .and. key_table(k)%name == key) exit
      end do
      default = trim(key_table(k)%default)
      ! defaults are usually written as in the table; the text of an entry ends before a closing quote
      if (group%entry(e)%text == default .or. group%entry(e)%text//"'" == default) return
      is_changed = default == "absent" .or. default == "required"
      if (is_changed) return
      call parse_namelist("&"//trim(group%name)//" "//key//" = "//default//" /", "", usual, error)
      is_changed = plain(group, key_table(k)) /= plain(usual%group(1), key_table(k))
   end function is_changed

   !> Return whether a surface may have its own rebounds anywhere.
   pure logical function has_grounds(surface)
      type(group_t), intent(in) :: surface

      has_grounds = has_key(surface, "ground") .or. has_key(surface, "ground_map") .or. has_key(surface, "zones")
   end function has_grounds

   pure logical function any_grounds(list)
      type(namelist_t), intent(in) :: list
      integer :: g

      any_grounds = .false.
      do g = 1, size(list%group)
         if (list%group(g)%name == "surface") any_grounds = any_grounds .or. has_grounds(list%group(g))
      end do
   end function any_grounds

   !> Return whether boulders rebound by an impact table by default.
   pure logical function by_table(list)
      type(namelist_t), intent(in) :: list
      integer :: g

      by_table = .false.
      do g = 1, size(list%group)
         if (list%group(g)%name == "impact") by_table = by_table .or. text_of(list%group(g), "form") == "table"
      end do
   end function by_table

   !> Return whether rocks may have sizes anywhere.
   pure logical function any_rocks(list)
      type(namelist_t), intent(in) :: list
      character(len=*), parameter :: sizes(*) = [character(len=key_length) :: "zones", "mean_radius", "rg70", &
                                                 "uniform_mean_radius", "uniform_rg"]
      integer :: g, k

      any_rocks = .false.
      do g = 1, size(list%group)
         if (list%group(g)%name == "surface") &
            any_rocks = any_rocks .or. any([(has_key(list%group(g), trim(sizes(k))), k=1, size(sizes))])
      end do
   end function any_rocks

   !> Return whether a map whose name contains a word is requested.
   pure logical function has_maps(list, word)
      type(namelist_t), intent(in) :: list
      character(len=*), intent(in) :: word
      character(len=map_length), allocatable :: maps(:)
      type(error_t), allocatable :: error
      integer :: g

      has_maps = .false.
      do g = 1, size(list%group)
         if (list%group(g)%name /= "output") cycle
         maps = [character(len=map_length) ::]
         call get_text(list%group(g), "maps", maps, error)
         has_maps = any(index(maps, word) > 0)
      end do
   end function has_maps
end module rockfall_case_effects
