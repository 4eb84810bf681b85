// Included in the middle of Eigen, by EIGEN_MATRIXBASE_PLUGIN on arm64: after the packets, which announce that products
// can be fused (they are not: arm_neon.h beside this), and before the products, which would then take their columns in
// other groups than on amd64.
#undef EIGEN_HAS_SINGLE_INSTRUCTION_MADD
