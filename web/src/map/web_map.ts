// SPDX-License-Identifier: BSD-3-Clause
// Web map service added by the user; without it, no request leaves the machine.
import ImageWMS from 'ol/source/ImageWMS';
import type { WebMap } from '../protocol';

/** WMS source in the CRS of the terrain, under the map's own code. */
export function webMapSource({ url, layers, crs }: WebMap, code: string): ImageWMS {
  return new ImageWMS({
    url,
    params: { LAYERS: layers, VERSION: '1.1.1', FORMAT: 'image/png' }, // version 1.1.1 has x before y in every CRS
    ratio: 1,
    crossOrigin: 'anonymous', // required to export the map as a picture
    imageLoadFunction: (image, address) => {
      const asked = new URL(address);
      if (asked.searchParams.get('SRS') === code) asked.searchParams.set('SRS', crs);
      (image.getImage() as HTMLImageElement).src = asked.href;
    },
  });
}
