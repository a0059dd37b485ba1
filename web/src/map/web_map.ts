// SPDX-License-Identifier: BSD-3-Clause
// Web map service added by the user; without it, no request leaves the machine.
import ImageWMS from 'ol/source/ImageWMS';
import type { WebMap } from '../protocol';

/** Service in the CRS of the terrain, for which the map has its own code. */
export function webMapSource({ url, layers, crs }: WebMap, code: string): ImageWMS {
  return new ImageWMS({
    url,
    params: { LAYERS: layers, VERSION: '1.1.1', FORMAT: 'image/png' }, // x before y in every CRS
    ratio: 1,
    crossOrigin: 'anonymous', // required to save a picture of the map
    imageLoadFunction: (image, address) => {
      const asked = new URL(address);
      if (asked.searchParams.get('SRS') === code) asked.searchParams.set('SRS', crs);
      (image.getImage() as HTMLImageElement).src = asked.href;
    },
  });
}
