// Stands before the compiler's <arm_neon.h> on arm64: the same, but a*b+c rounds twice, after the product and after the sum. Eigen asks
// for fused products by name wherever a processor has them, so -ffp-contract=off does not reach them; Debian's amd64 has none.
// With this, both give the same bits: Eigen's packets are as wide on both, and it adds their elements in the same order.
#pragma once

#include_next <arm_neon.h>

#define vfma_f32(c, a, b) vadd_f32(c, vmul_f32(a, b))
#define vfmaq_f32(c, a, b) vaddq_f32(c, vmulq_f32(a, b))
#define vfmaq_f64(c, a, b) vaddq_f64(c, vmulq_f64(a, b))
#define vfmaq_n_f32(c, a, b) vaddq_f32(c, vmulq_n_f32(a, b))
#define vfmaq_n_f64(c, a, b) vaddq_f64(c, vmulq_n_f64(a, b))
#define vfmaq_laneq_f32(c, a, b, lane) vaddq_f32(c, vmulq_laneq_f32(a, b, lane))
#define vfmaq_laneq_f64(c, a, b, lane) vaddq_f64(c, vmulq_laneq_f64(a, b, lane))
