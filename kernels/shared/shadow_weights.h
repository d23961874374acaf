// Written by tests/accuracy/shadow_rule.py; features, bases and their order are those of kde_shadow.h.
#pragma once

namespace kinevox::kernels::kde {

inline constexpr int kOwnShadowFeatures = 22, kShadowFeatures = 27, kShadowBases = 10;
inline constexpr int kLighterFeatures = 10;

// Handed to kernels by value.
struct ShadowRule {
    float weights[kShadowFeatures] = {-73.893f,   19.009f,  -0.031978f, 0.6709f,  -5.9643f, 20.12f,  54.667f,
                                      0.0024178f, 22.56f,   255.43f,    0.0f,     -2.1864f, 9.2224f, 8.1286f,
                                      -0.91919f,  14.859f,  -20.982f,   -27.198f, 133.72f,  17.347f, -69.01f,
                                      -157.1f,    -3.2548f, 23.969f,    -18.702f, -9.4018f, -4.6134f};
    // Of the products of the bases i <= j, row by row.
    float products[kShadowBases * (kShadowBases + 1) / 2] = {
        -2.336f,   -1.4562f,  1.4689f,  0.70896f,  3.8443f,    -1.7537f,  0.99993f,  12.366f,
        -6.9461f,  -0.97069f, 9.9216f,  0.10517f,  -1.9295f,   -6.8041f,  -0.52424f, 0.96737f,
        1.3853f,   0.39455f,  -1.2785f, -0.15888f, -0.026561f, -16.867f,  0.12378f,  0.93713f,
        -0.83377f, 3.4945f,   0.10739f, 0.568f,    0.0f,       -0.49952f, -4.3133f,  -9.7372f,
        5.1578f,   -10.075f,  17.379f,  -2.3739f,  -1.1792f,   -1063.8f,  10.62f,    0.47419f,
        -0.23057f, -0.40815f, 4.3584f,  7.1953f,   -7.3473f,   -1.0941f,  -0.25357f, -1.3552f,
        1.4406f,   -8.6268f,  -18.107f, -20.634f,  -1.1025f,   -6.9148f,  14.859f};
    // Of the products of the bases and the votes' support, all and the positive part of it.
    float vote_products[kShadowBases] = {-3.3204f, 2.6485f,  -0.49254f, 8.4178f, -54.701f,
                                         -1.6082f, -3.2695f, -12.921f,  91.439f, -11.821f};
    float positive_vote_products[kShadowBases] = {9.6909f,   -2.2234f, -0.24598f, -9.3093f, 57.469f,
                                                  -0.47133f, 6.1168f,  20.486f,   -114.39f, 3.8871f};
    // Of a lighter pixel's features 0, 1, 2, 4, 9, 10, 12, 13, 15, 19.
    float lighter[kLighterFeatures] = {-58.096f, 19.135f, 1.3305f, -2.6866f, -215.76f,
                                       147.1f,   5.375f,  9.4682f, -17.6f,   28.437f};
};

}  // namespace kinevox::kernels::kde
