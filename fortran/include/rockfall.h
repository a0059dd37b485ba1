/* SPDX-License-Identifier: BSD-3-Clause */
/* Rockfall trajectories with a stochastic impact model: the kernel for C, and for all that can call C.

   A scene is made of a case (its text, docs/case.md) and of arrays; runs of it go on in chunks of any size and fill
   arrays that are found by name. Results are the bits of the other programs, whatever the chunks and the threads.

      rockfall_scene *scene = rockfall_new_scene(west, north, cell, nx, ny);
      rockfall_give(scene, "elevation", "f4", (int64_t[3]){nx, ny, 1}, z);
      ...
      if (rockfall_build_scene(scene, text, "case.nml", message)) ...
      if (rockfall_open_run(scene, 0, rockfall_boulders(scene), 0, &run, message)) ...
      if (rockfall_advance(run, n, message)) ...
      for (k = 0; rockfall_array(run, k, text, length, &at); k++) ...

   Functions that can fail return 0, or 2 for invalid input and 1 for an internal error, and then write one line to
   `message`. A scene, and a run, must not be used by two threads at a time; several scenes may. */
#ifndef ROCKFALL_H
#define ROCKFALL_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Lengths of texts, including the final zero; a message has one line for each fault. */
enum { ROCKFALL_MESSAGE = 1024, ROCKFALL_TEXT = 256 };

typedef struct rockfall_scene rockfall_scene;
typedef struct rockfall_run rockfall_run;

/* New empty scene: west and north edge and size of the square cells [m], columns and rows of its rasters. */
rockfall_scene *rockfall_new_scene(double west, double north, double cell, int32_t nx, int32_t ny);

/* Give an array: name and type ("f8", "f4", "i4", "i2", "i1") as docs/files.md lists them for scene files, lengths (the
   first varies fastest, 1 beyond the last), values. Needed are `elevation` (nx, ny) [m], f4 or f8, row 1 in the north, NaN
   for no data; `source_x`, `source_y` [m], f8; `impact_sets`, the bytes of a set file, i1; and either `material_size`
   (1 or 3, materials) with `zone`, or one material everywhere. `elevation`, `zone`, `cell_size`, `cell_ground`, `tree_*`,
   `table_*` remain yours and must not change until the scene is closed. Once the scene is built, this has no effect. */
void rockfall_give(rockfall_scene *scene, const char *name, const char *type, const int64_t length[3],
                   const void *values);

/* Build the scene from the text of a case; `name` is that of the case in messages. Layers must be coordinates in the
   text, as `rockfall prepare` writes them. A scene that cannot be built can only be closed. */
int rockfall_build_scene(rockfall_scene *scene, const char *text, const char *name, char message[ROCKFALL_MESSAGE]);

/* Number of boulders of a scene, over all sources. */
int64_t rockfall_boulders(const rockfall_scene *scene);

/* Close a scene, after its runs. */
void rockfall_close_scene(rockfall_scene *scene);

/* Open a run of `boulders` boulders of a scene, starting after the first `before`; threads: 0 for all cores. Fails if
   no boulder can start from a source, or if a map could overflow. */
int rockfall_open_run(rockfall_scene *scene, int64_t before, int64_t boulders, int threads, rockfall_run **run,
                      char message[ROCKFALL_MESSAGE]);

/* Run the next n boulders. */
int rockfall_advance(rockfall_run *run, int64_t n, char message[ROCKFALL_MESSAGE]);

/* Array k of a run, from 0: "group name file_name type dimension ..." (names as in docs/result.md), lengths of up to
   four dimensions, the first varies fastest, and the values, which are the run's. Returns 0 past the last array. List from
   k = 0 again after rockfall_advance: this sorts crossings by line, those of a line by boulder (0 if memory is short). */
int rockfall_array(rockfall_run *run, int k, char text[ROCKFALL_TEXT], int64_t length[4], const void **values);

/* One of the maps listed under &output maps, over the boulders run so far, on the cells of the run's map arrays.
   per_cluster: number of boulders that may behave alike, for confidence intervals; 1 if all are independent. */
int rockfall_map(rockfall_run *run, const char *name, int64_t per_cluster, float *values,
                 char message[ROCKFALL_MESSAGE]);

/* Close a run. */
void rockfall_close_run(rockfall_run *run);

#ifdef __cplusplus
}
#endif
#endif
