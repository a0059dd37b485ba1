/* SPDX-License-Identifier: BSD-3-Clause */
/* Random numbers of several impacts at a time: Philox4x32-10 and normal quantiles, bitwise identical to
   rockfall_random. Compiled three times, like rockfall_lanes; meson.build defines the name of the procedure. Written
   with intrinsics, because compilers use three multiplications for a product of 64-bit lanes where one suffices, and
   load the coefficients one by one. */
#include <math.h>
#include <stdint.h>
#include <string.h>
#if defined(__AVX2__)
#include <immintrin.h>
#endif

enum { ROUNDS = 10, POWERS = 6, WITHIN_BITS = 49, FIRST_PIECE = 1023 * 8 };
static const uint64_t M0 = 0xD2511F53, M1 = 0xCD9E8D57, LOW32 = 0xFFFFFFFF;
static const uint64_t WITHIN_MASK = (UINT64_C(1) << WITHIN_BITS) - 1, BITS_OF_ONE = UINT64_C(0x3FF0000000000000);
static const double TWO32 = 4294967296.0, MIDDLE = 1 + 1 / 16.0;

#if defined(__AVX2__)
static __m256i whole(uint64_t value)
{
    return _mm256_set1_epi64x((int64_t)value);
}

/* Standard normal numbers from four words. Coefficients of a piece are contiguous: rows are loaded and transposed. */
static __m256d normals(const double *table, __m256i word)
{
    const __m256d two52 = _mm256_set1_pd(4503599627370496.0), sign = _mm256_set1_pd(-0.0);
    __m256d real, side, x, row[4], pair[2], low[2], high[2], sum;
    __m256i bits, piece;
    int64_t at[4];

    real = _mm256_sub_pd(_mm256_or_pd(_mm256_castsi256_pd(word), two52), two52);
    side = _mm256_add_pd(_mm256_add_pd(real, real), _mm256_set1_pd(1 - TWO32));
    bits = _mm256_castpd_si256(_mm256_sub_pd(_mm256_set1_pd(TWO32), _mm256_andnot_pd(sign, side)));
    piece = _mm256_sub_epi64(_mm256_srli_epi64(bits, WITHIN_BITS), whole(FIRST_PIECE));
    bits = _mm256_or_si256(_mm256_and_si256(bits, whole(WITHIN_MASK)), whole(BITS_OF_ONE));
    x = _mm256_sub_pd(_mm256_castsi256_pd(bits), _mm256_set1_pd(MIDDLE));
    _mm256_storeu_si256((__m256i *)at, piece);
    for (int k = 0; k < 4; k++)
        row[k] = _mm256_loadu_pd(table + POWERS * at[k]);
    for (int k = 0; k < 2; k++)
        pair[k] = _mm256_insertf128_pd(_mm256_castpd128_pd256(_mm_loadu_pd(table + POWERS * at[k] + 4)),
                                       _mm_loadu_pd(table + POWERS * at[k + 2] + 4), 1);
    for (int k = 0; k < 2; k++) {
        low[k] = _mm256_unpacklo_pd(row[2 * k], row[2 * k + 1]);
        high[k] = _mm256_unpackhi_pd(row[2 * k], row[2 * k + 1]);
    }
    sum = _mm256_mul_pd(x, _mm256_unpackhi_pd(pair[0], pair[1]));
    sum = _mm256_mul_pd(x, _mm256_add_pd(_mm256_unpacklo_pd(pair[0], pair[1]), sum));
    sum = _mm256_mul_pd(x, _mm256_add_pd(_mm256_permute2f128_pd(high[0], high[1], 0x31), sum));
    sum = _mm256_mul_pd(x, _mm256_add_pd(_mm256_permute2f128_pd(low[0], low[1], 0x31), sum));
    sum = _mm256_mul_pd(x, _mm256_add_pd(_mm256_permute2f128_pd(high[0], high[1], 0x20), sum));
    sum = _mm256_add_pd(_mm256_permute2f128_pd(low[0], low[1], 0x20), sum);
    return _mm256_or_pd(_mm256_andnot_pd(sign, sum), _mm256_and_pd(sign, side));
}
#else
/* Standard normal number from a word. */
static double normal(const double *table, uint64_t word)
{
    const double side = 2 * (double)(int64_t)word + (1 - TWO32);
    const double tail = TWO32 - fabs(side);
    const double *c;
    uint64_t bits;
    double x, sum;

    memcpy(&bits, &tail, sizeof bits);
    c = table + POWERS * (int64_t)((bits >> WITHIN_BITS) - FIRST_PIECE);
    bits = (bits & WITHIN_MASK) | BITS_OF_ONE;
    memcpy(&x, &bits, sizeof x);
    x -= MIDDLE;
    sum = c[0] + x * (c[1] + x * (c[2] + x * (c[3] + x * (c[4] + x * c[5]))));
    return copysign(sum, side);
}
#endif

/* Random words of n impacts from their counters (boulder, impact, and a common last word) and, if `with_normals`,
   standard normal numbers from the first three words. Arrays are padded to a multiple of four. */
void impact_numbers(const uint64_t round[ROUNDS][2], const double *table, int with_normals, int n,
                    const uint64_t *boulder, const uint64_t *impact, uint64_t last, uint64_t *w1, uint64_t *w2,
                    uint64_t *w3, uint64_t *w4, double *z1, double *z2, double *z3)
{
#if defined(__AVX2__)
    for (int k = 0; k < n; k += 4) {
        __m256i c0 = _mm256_loadu_si256((const __m256i *)(boulder + k)), c1 = _mm256_srli_epi64(c0, 32);
        __m256i c2 = _mm256_loadu_si256((const __m256i *)(impact + k)), c3 = whole(last);

        for (int r = 0; r < ROUNDS; r++) { /* only the lower halves are used */
            const __m256i p0 = _mm256_mul_epu32(c0, whole(M0)), p1 = _mm256_mul_epu32(c2, whole(M1));

            c0 = _mm256_xor_si256(_mm256_xor_si256(_mm256_srli_epi64(p1, 32), c1), whole(round[r][0]));
            c2 = _mm256_xor_si256(_mm256_xor_si256(_mm256_srli_epi64(p0, 32), c3), whole(round[r][1]));
            c1 = p1;
            c3 = p0;
        }
        c0 = _mm256_and_si256(c0, whole(LOW32));
        c1 = _mm256_and_si256(c1, whole(LOW32));
        c2 = _mm256_and_si256(c2, whole(LOW32));
        c3 = _mm256_and_si256(c3, whole(LOW32));
        _mm256_storeu_si256((__m256i *)(w1 + k), c0);
        _mm256_storeu_si256((__m256i *)(w2 + k), c1);
        _mm256_storeu_si256((__m256i *)(w3 + k), c2);
        _mm256_storeu_si256((__m256i *)(w4 + k), c3);
        if (!with_normals)
            continue;
        _mm256_storeu_pd(z1 + k, normals(table, c0));
        _mm256_storeu_pd(z2 + k, normals(table, c1));
        _mm256_storeu_pd(z3 + k, normals(table, c2));
    }
#else
    for (int k = 0; k < n; k++) {
        uint64_t c0 = boulder[k] & LOW32, c1 = boulder[k] >> 32, c2 = impact[k] & LOW32, c3 = last;

        for (int r = 0; r < ROUNDS; r++) {
            const uint64_t p0 = M0 * c0, p1 = M1 * c2;

            c0 = (p1 >> 32) ^ c1 ^ round[r][0];
            c2 = (p0 >> 32) ^ c3 ^ round[r][1];
            c1 = p1 & LOW32;
            c3 = p0 & LOW32;
        }
        w1[k] = c0;
        w2[k] = c1;
        w3[k] = c2;
        w4[k] = c3;
        if (!with_normals)
            continue;
        z1[k] = normal(table, c0);
        z2[k] = normal(table, c1);
        z3[k] = normal(table, c2);
    }
#endif
}
