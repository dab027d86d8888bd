// SPDX-License-Identifier: Apache-2.0
/* Functions that are compiled twice, for processors with AVX2 and for all others; which one is called
 * is decided when the library is loaded. Both give the same bits: compilers may neither contract nor
 * reorder operations here (see `pyproject.toml`). */

#ifndef GROUNDLINK_VECTORIZED_H
#define GROUNDLINK_VECTORIZED_H

#if defined(__x86_64__) && defined(__GLIBC__)
#define VECTORIZED __attribute__((target_clones("avx2", "default")))
#else
#define VECTORIZED
#endif

/* A part of such a function. */
#define INLINED inline __attribute__((always_inline))

#endif
