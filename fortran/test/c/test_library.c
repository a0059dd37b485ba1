/* SPDX-License-Identifier: BSD-3-Clause */
/* C interface on an inclined plane: an example, and tests of its documented behaviour. */
#include <math.h>
#include <rockfall.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { NX = 60, NY = 200, BOULDERS = 500 };

static const char text[] =
    "&case boulders = 500, seed = 3 /\n"
    "&terrain dem = '(array)' /\n"
    "&surface uniform_mean_radius = 0.2 /\n"
    "&boulder volume_mean = 0.5 /\n"
    "&release x = 60.0, y = 380.0, drop_height = 2.0 /\n"
    "&line name = 'road', x = 2.0, 118.0, y = 90.0, 90.0 /\n"
    "&output maps = 'passages', 'energy_max' /\n";
static char message[ROCKFALL_MESSAGE];
static int failures;

static void check(const char *name, int is_true)
{
    printf("%s %s\n", is_true ? "ok    " : "FAILED", name);
    failures += !is_true;
}

/* Read all bytes of a file; ends the program if it cannot be read. */
static char *read_file(const char *path, int64_t *length)
{
    FILE *file = fopen(path, "rb");
    char *bytes = malloc(1 << 20);

    if (file == NULL || bytes == NULL)
        exit(1);
    *length = (int64_t)fread(bytes, 1, 1 << 20, file);
    fclose(file);
    return bytes;
}

static void give(rockfall_scene *scene, const char *name, const char *type, int64_t nx, int64_t ny, const void *values)
{
    rockfall_give(scene, name, type, (int64_t[3]){nx, ny, 1}, values);
}

/* Scene of the plane with elevations `z` and the impact sets of a file. */
static rockfall_scene *plane(const float *z, const char *sets)
{
    static const double x = 60.0, y = 380.0, radius = 0.2;
    rockfall_scene *scene = rockfall_new_scene(0.0, 400.0, 2.0, NX, NY);
    int64_t length;
    char *bytes = read_file(sets, &length);

    give(scene, "elevation", "f4", NX, NY, z);
    give(scene, "source_x", "f8", 1, 1, &x);
    give(scene, "source_y", "f8", 1, 1, &y);
    give(scene, "material_size", "f8", 1, 1, &radius);
    give(scene, "impact_sets", "i1", length, 1, bytes);
    free(bytes);
    return scene;
}

/* Array of a run by its name in files; NULL if there is none. Its size is returned in `n`. */
static const void *array(rockfall_run *run, const char *wanted, int64_t *n)
{
    char row[ROCKFALL_TEXT], group[64], name[64], file_name[64], type[8];
    const void *values;
    int64_t length[4];

    for (int k = 0; rockfall_array(run, k, row, length, &values); k++) {
        if (sscanf(row, "%63s %63s %63s %7s", group, name, file_name, type) == 4 && strcmp(file_name, wanted) == 0) {
            *n = length[0] * length[1] * length[2] * length[3];
            return values;
        }
    }
    *n = 0;
    return NULL;
}

/* Run all boulders in chunks, and copy their stopping points. */
static void run_in_chunks(rockfall_scene *scene, int64_t chunk, int threads, double *stop_y)
{
    rockfall_run *run;
    int64_t n;

    if (rockfall_open_run(scene, 0, BOULDERS, threads, &run, message) != 0)
        exit(1);
    for (int64_t done = 0; done < BOULDERS; done += chunk)
        if (rockfall_advance(run, chunk, message) != 0)
            exit(1);
    memcpy(stop_y, array(run, "stop_y", &n), BOULDERS * sizeof *stop_y);
    rockfall_close_run(run);
}

int main(int argc, char **argv)
{
    static float z[NY][NX], passages[NY * NX];
    static double together[BOULDERS], apart[BOULDERS];
    rockfall_scene *scene;
    rockfall_run *run;
    int64_t n;

    if (argc < 2)
        return 1;
    for (int row = 0; row < NY; row++)
        for (int column = 0; column < NX; column++)
            z[row][column] = 1000.0f - 2.0f * (float)row * (row < 120 ? 0.8f : 0.0f) - (row < 120 ? 0.0f : 192.0f);

    scene = plane(&z[0][0], argv[1]);
    check("an unknown key is refused in one line",
          rockfall_build_scene(scene, "&boulder mass = 1.0 /", "case.nml", message) == 2 &&
              strstr(message, "case.nml: line 1: &boulder mass") == message && strchr(message, '\n') == NULL);
    check("a scene that is not built has no boulders", rockfall_boulders(scene) == 0);
    rockfall_close_scene(scene);

    scene = rockfall_new_scene(0.0, 400.0, 2.0, NX, NY);
    check("a scene without elevations is refused", rockfall_build_scene(scene, text, "case.nml", message) == 2);
    rockfall_close_scene(scene);

    scene = plane(&z[0][0], argv[1]);
    check("the scene is built", rockfall_build_scene(scene, text, "case.nml", message) == 0 && message[0] == '\0');
    check("it has the boulders of the case", rockfall_boulders(scene) == BOULDERS);
    check("more boulders than there are are refused",
          rockfall_open_run(scene, 1, BOULDERS, 0, &run, message) == 2 && run == NULL);

    run_in_chunks(scene, BOULDERS, 1, together);
    run_in_chunks(scene, 50, 2, apart);
    check("chunks and threads do not matter", memcmp(together, apart, sizeof together) == 0);

    check("the run opens", rockfall_open_run(scene, 0, BOULDERS, 0, &run, message) == 0);
    check("it advances", rockfall_advance(run, BOULDERS, message) == 0);
    check("no further than its end", rockfall_advance(run, 1, message) == 2);
    check("an unknown map is refused", rockfall_map(run, "deposits", 1, passages, message) == 2);
    check("a map is made", rockfall_map(run, "passages", 1, passages, message) == 0);
    double most = 0.0;
    for (int k = 0; k < NX * NY; k++)
        most = fmax(most, passages[k]);
    check("every boulder passes the cell of the source", most == BOULDERS);
    const float *time = array(run, "crossing_time", &n);
    const int32_t *line = array(run, "crossing_line", &n);
    const int64_t *boulder = array(run, "crossing_boulder", &n);
    const int64_t passed = n;
    check("some boulders cross the line", time && line && boulder && passed > 0 && passed < BOULDERS);
    int64_t good = 0;
    for (int64_t k = 0; k < passed; k++)
        good += line[k] == 0 && boulder[k] >= 1 && boulder[k] <= BOULDERS && (k == 0 || boulder[k] > boulder[k - 1]) &&
                time[k] > 0.0f;
    check("each at most once, in order, after its release", good == passed);
    printf("%lld of %d boulders pass the road\n", (long long)passed, BOULDERS);
    rockfall_close_run(run);
    rockfall_close_scene(scene);
    return failures != 0;
}
