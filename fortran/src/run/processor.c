#include <stdlib.h>
int rockfall_lanes_here(void) {
  const char *s = getenv("LANES");
  if (s) return atoi(s);
#if defined(__x86_64__)
  __builtin_cpu_init();
  return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("bmi2") ? 2 : 1;
#else
  return 1;
#endif
}
