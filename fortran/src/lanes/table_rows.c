/* SPDX-License-Identifier: BSD-3-Clause */
/* Impact tables for several contacts at a time: finds the bins in the same way as rockfall_impact_table, and reads rows
   of a table, anywhere in memory, into columns of lanes by vector loads and shuffles. Compiled three times, like
   rockfall_lanes; meson.build defines the names of the procedures. */
#if defined(__AVX2__)
#include <immintrin.h>

/* Transpose four rows of four numbers. */
static void transpose(__m256d row0, __m256d row1, __m256d row2, __m256d row3, double *column, int lanes)
{
    const __m256d low0 = _mm256_unpacklo_pd(row0, row1), low1 = _mm256_unpacklo_pd(row2, row3);
    const __m256d high0 = _mm256_unpackhi_pd(row0, row1), high1 = _mm256_unpackhi_pd(row2, row3);

    _mm256_storeu_pd(column, _mm256_permute2f128_pd(low0, low1, 0x20));
    _mm256_storeu_pd(column + lanes, _mm256_permute2f128_pd(high0, high1, 0x20));
    _mm256_storeu_pd(column + 2 * lanes, _mm256_permute2f128_pd(low0, low1, 0x31));
    _mm256_storeu_pd(column + 3 * lanes, _mm256_permute2f128_pd(high0, high1, 0x31));
}
#endif

/* Read n records in single and n maps in double precision from their addresses. The numbers of lanes and of values per
   row are multiples of four. */
void read_rows(int n, int lanes, int record_fields, const float *const *record_at, double *record, int map_fields,
               const double *const *map_at, double *map)
{
#if defined(__AVX2__)
    for (int k = 0; k < n; k += 4) {
        const float *const *r = record_at + k;
        const double *const *w = map_at + k;

        for (int field = 0; field < record_fields; field += 4)
            transpose(_mm256_cvtps_pd(_mm_loadu_ps(r[0] + field)), _mm256_cvtps_pd(_mm_loadu_ps(r[1] + field)),
                      _mm256_cvtps_pd(_mm_loadu_ps(r[2] + field)), _mm256_cvtps_pd(_mm_loadu_ps(r[3] + field)),
                      record + k + (long)field * lanes, lanes);
        for (int field = 0; field < map_fields; field += 4)
            transpose(_mm256_loadu_pd(w[0] + field), _mm256_loadu_pd(w[1] + field), _mm256_loadu_pd(w[2] + field),
                      _mm256_loadu_pd(w[3] + field), map + k + (long)field * lanes, lanes);
    }
#else
    for (int k = 0; k < n; k++) {
        for (int field = 0; field < record_fields; field++)
            record[k + (long)field * lanes] = record_at[k][field];
        for (int field = 0; field < map_fields; field++)
            map[k + (long)field * lanes] = map_at[k][field];
    }
#endif
}

/* Number of edges, each multiplied by a unit, below a value; edges fill vectors of four. */
static int edges_below(const double *edge, int vectors, double unit, double value)
{
    int below = 0;
#if defined(__AVX2__)
    const __m256d units = _mm256_set1_pd(unit), values = _mm256_set1_pd(value);

    for (int k = 0; k < vectors; k++)
        below += __builtin_popcount((unsigned)_mm256_movemask_pd(
            _mm256_cmp_pd(_mm256_mul_pd(_mm256_loadu_pd(edge + 4 * k), units), values, _CMP_LT_OQ)));
#else
    for (int k = 0; k < 4 * vectors; k++)
        below += edge[k] * unit < value;
#endif
    return below;
}

static int smaller(int a, int b)
{
    return a < b ? a : b;
}

/* Bins of n contacts within their parts, from their keys, as in `key_bin` of rockfall_impact_table. `contact` counts
   from 1, `count` and `vectors` are those of bins_t. */
void find_bins(int n, const int *contact, const double *key1, const double *over1, const double *key2,
               const double *over2, const double *key3, const int *part, const int *count, const int *vectors,
               const double *first_edge, const double *second_edge, const double *third_edge, int *bin)
{
    const int bins = count[0], inner = count[1], innermost = count[2];

    for (int m = 0; m < n; m++) {
        const int at = contact[m] - 1, before = part[at] - 1;
        int i, j;

        i = smaller(bins - 1, edges_below(first_edge + 4 * vectors[0] * before, vectors[0], over1[at], key1[at]));
        i += bins * before;
        j = smaller(inner - 1, edges_below(second_edge + 4 * vectors[1] * i, vectors[1], over2[at], key2[at]));
        j += inner * i;
        i = smaller(innermost - 1, edges_below(third_edge + 4 * vectors[2] * j, vectors[2], 1.0, key3[at]));
        bin[at] = i + innermost * (j - inner * bins * before) + 1;
    }
}
