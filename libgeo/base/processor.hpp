// Loops over whole numbers that gain from wide registers are compiled twice, for AVX2 and for the baseline; the loader
// picks what the processor has. Only for integers: floats could then differ between machines.
#pragma once

#if defined(__x86_64__) && defined(__linux__) && !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__) && \
    !defined(__clang__)
#define NADIR_FOR_WIDE_REGISTERS __attribute__((target_clones("avx2", "default")))
#else
#define NADIR_FOR_WIDE_REGISTERS  // sanitizers start later than the loader's choice
#endif
