// SPDX-License-Identifier: BSD-3-Clause
// A web map service that the user added: without one, no request leaves the machine.
import ImageWMS from 'ol/source/ImageWMS';
import type { WebMap } from '../protocol';

/** A service in the CRS of the terrain, which the map knows by a code of its own. */
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
