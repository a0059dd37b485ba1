/* SPDX-License-Identifier: BSD-3-Clause */
/* Whether the processor has what meson.build compiles the wide lanes for. */
int rockfall_is_wide(void)
{
#if defined(__x86_64__)
    __builtin_cpu_init();
    return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("bmi") && __builtin_cpu_supports("bmi2");
#else
    return 0;
#endif
}
