! SPDX-License-Identifier: BSD-3-Clause
!> Many random throws at rocks. A throw is a pure function of (seed, number) and its layer, which is a pure function of
!> (seed, ratio, layer), so results do not depend on threads and chunks.
module lab_rock_throws
   use rockfall_kinds, only: wp, i8
   use rockfall_threads, only: team_size
   use rockfall_random, only: random_key_t
   use lab_contact, only: material_t
   use lab_rotation, only: any_orientation
   use lab_packing, only: packing_t, layer_t
   use lab_contact_record, only: thrown_t
   use lab_throw_range, only: throw_range_t, draw_throw
   use lab_rock_throw, only: boulder_t, follow_on_rocks
   implicit none
   private
   public :: throw_on_rocks

   integer(i8), parameter :: for_rock_throw = 70, for_rock_throw_attitude = 73  !! purposes of the random numbers

contains

   !> Throw the boulders with the given numbers, each at the layer with the given index.
   subroutine throw_on_rocks(layers, packing, material, boulder, range, contacts, key, place, layer, number, threads, &
                             thrown)
      type(layer_t), intent(in) :: layers(:)
      type(packing_t), intent(in) :: packing
      type(material_t), intent(in) :: material
      type(boulder_t), intent(in) :: boulder
      type(throw_range_t), intent(in) :: range
      integer, intent(in) :: contacts    !! maximum number of contacts per throw
      type(random_key_t), intent(in) :: key
      integer, intent(in) :: place(:)    !! index of each throw's layer
      integer, intent(in) :: layer(:)    !! number of each throw's layer
      integer(i8), intent(in) :: number(:)
      integer, intent(in) :: threads     !! number of threads; 0: all
      type(thrown_t), intent(out) :: thrown(:)
      real(wp) :: choice
      integer :: k

      !$omp parallel do default(none) schedule(dynamic, 1) num_threads(team_size(threads)) &
      !$omp& shared(layers, packing, material, boulder, range, contacts, key, place, layer, number, thrown) &
      !$omp& private(k, choice)
      do k = 1, size(thrown)
         associate (o => thrown(k), of => layers(place(k)))
            call draw_throw(range, key, for_rock_throw, number(k), o%throw, choice)
            o%throw%place = of%box%width*o%throw%place
            if (allocated(boulder%shape)) &
               o%throw%orientation = any_orientation(key, for_rock_throw_attitude, number(k), 0_i8)
            o%body = layer(k)
            allocate (o%contacts(contacts))
            call follow_on_rocks(of, packing, material, boulder, o%throw, key, number(k), o%contacts, o%n, o%complete)
         end associate
      end do
      !$omp end parallel do
   end subroutine throw_on_rocks
end module lab_rock_throws
