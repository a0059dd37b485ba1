/* SPDX-License-Identifier: BSD-3-Clause */

/* Load the cache line of an address into the cache without waiting for it, which Fortran cannot express. */
void rockfall_prefetch(const void *address)
{
#if defined(__GNUC__)
    __builtin_prefetch(address);
#else
    (void)address;
#endif
}
