/* SPDX-License-Identifier: BSD-3-Clause */
/* Elevations of several patches or cells at a time, in single precision: one load reads neighbours in a row. Compiled
   three times, like rockfall_lanes; meson.build defines the names of the procedures. */
#include <stdint.h>
#if defined(__AVX2__)
#include <immintrin.h>
#endif

/* Read the corners of n patches of a raster with `row` columns; `at` is the index of the south-western corner, from 1.
   Arrays are padded to a multiple of four, and all indices are valid. */
void read_corners(int n, const double *at, int64_t row, const float *z, double *z00, double *z10, double *z01,
                  double *z11)
{
#if defined(__AVX2__)
    const __m256d two52 = _mm256_set1_pd(4503599627370496.0);
    const __m256i first = _mm256_add_epi64(_mm256_castpd_si256(two52), _mm256_set1_epi64x(1));

    for (int k = 0; k < n; k += 4) {
        const __m256d index = _mm256_add_pd(_mm256_loadu_pd(at + k), two52);
        const __m256i south = _mm256_sub_epi64(_mm256_castpd_si256(index), first);
        const __m256i north = _mm256_sub_epi64(south, _mm256_set1_epi64x(row));
        const __m256 low = _mm256_castpd_ps(_mm256_i64gather_pd((const double *)z, south, 4));
        const __m256 high = _mm256_castpd_ps(_mm256_i64gather_pd((const double *)z, north, 4));
        const __m256d west = _mm256_permute4x64_pd(
            _mm256_castps_pd(_mm256_shuffle_ps(low, high, _MM_SHUFFLE(2, 0, 2, 0))), _MM_SHUFFLE(3, 1, 2, 0));
        const __m256d east = _mm256_permute4x64_pd(
            _mm256_castps_pd(_mm256_shuffle_ps(low, high, _MM_SHUFFLE(3, 1, 3, 1))), _MM_SHUFFLE(3, 1, 2, 0));

        _mm256_storeu_pd(z00 + k, _mm256_cvtps_pd(_mm256_castps256_ps128(_mm256_castpd_ps(west))));
        _mm256_storeu_pd(z01 + k, _mm256_cvtps_pd(_mm256_extractf128_ps(_mm256_castpd_ps(west), 1)));
        _mm256_storeu_pd(z10 + k, _mm256_cvtps_pd(_mm256_castps256_ps128(_mm256_castpd_ps(east))));
        _mm256_storeu_pd(z11 + k, _mm256_cvtps_pd(_mm256_extractf128_ps(_mm256_castpd_ps(east), 1)));
    }
#else
    for (int k = 0; k < n; k++) {
        const float *south = z + (int64_t)at[k] - 1, *north = south - row;

        z00[k] = south[0];
        z10[k] = south[1];
        z01[k] = north[0];
        z11[k] = north[1];
    }
#endif
}

/* Read n squares of 3 x 3 cells of a raster with `columns` columns to z, row by row from the north-west, `lanes`
   numbers apart. `at` is the index of the north-western cell, from 1. Arrays are padded as in read_corners. */
void read_squares(int n, const double *at, int64_t columns, const float *elevation, int64_t lanes, double *z)
{
#if defined(__AVX2__)
    const __m256d two52 = _mm256_set1_pd(4503599627370496.0);
    const __m256i first = _mm256_add_epi64(_mm256_castpd_si256(two52), _mm256_set1_epi64x(1));
    const __m256i pairs = _mm256_set_epi32(7, 5, 3, 1, 6, 4, 2, 0);

    for (int k = 0; k < n; k += 4) {
        const __m256d index = _mm256_add_pd(_mm256_loadu_pd(at + k), two52);
        __m256i west = _mm256_sub_epi64(_mm256_castpd_si256(index), first);

        for (int triple = 0; triple < 3; triple++) {
            double *row = z + k + 3 * triple * lanes;
            const __m256 two = _mm256_permutevar8x32_ps(
                _mm256_castpd_ps(_mm256_i64gather_pd((const double *)elevation, west, 4)), pairs);
            const __m128 third = _mm256_i64gather_ps(elevation + 2, west, 4);

            _mm256_storeu_pd(row, _mm256_cvtps_pd(_mm256_castps256_ps128(two)));
            _mm256_storeu_pd(row + lanes, _mm256_cvtps_pd(_mm256_extractf128_ps(two, 1)));
            _mm256_storeu_pd(row + 2 * lanes, _mm256_cvtps_pd(third));
            west = _mm256_add_epi64(west, _mm256_set1_epi64x(columns));
        }
    }
#else
    for (int k = 0; k < n; k++)
        for (int cell = 0; cell < 9; cell++)
            z[k + cell * lanes] = elevation[(int64_t)at[k] - 1 + cell / 3 * columns + cell % 3];
#endif
}
