/* SPDX-License-Identifier: BSD-3-Clause */
/* Most advanced execution mode that the processor supports, numbered as in rockfall_scene_type; meson.build lists the
   instructions that each mode requires. */
int rockfall_supported_lanes(void)
{
#if defined(__x86_64__)
    __builtin_cpu_init();
    if (!__builtin_cpu_supports("avx2") || !__builtin_cpu_supports("bmi") || !__builtin_cpu_supports("bmi2"))
        return 1;
    if (!__builtin_cpu_supports("avx512f") || !__builtin_cpu_supports("avx512vl") ||
        !__builtin_cpu_supports("avx512dq") || !__builtin_cpu_supports("avx512bw"))
        return 2;
    return 3;
#else
    return 1;
#endif
}
