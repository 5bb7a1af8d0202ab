// Gauss's rules.
#pragma once

#include <cmath>
#include <numbers>

namespace volillum {

// Nodes and weights on [0, 1], at most 6.
struct Rule {
    int count;
    double x[6], w[6];
};

inline Rule gauss(int count) {
    Rule rule{count, {}, {}};
    for (int i = 0; i < count; ++i) {
        double x = std::cos(std::numbers::pi * (i + 0.75) / (count + 0.5)), slope = 1.0;
        for (int step = 0; step < 20; ++step) {
            double last = 1.0, value = x;
            for (int n = 2; n <= count; ++n) {
                const double next = ((2 * n - 1) * x * value - (n - 1) * last) / n;
                last = value;
                value = next;
            }
            slope = count == 1 ? 1.0 : count * (x * value - last) / (x * x - 1);
            x -= value / slope;
        }
        rule.x[i] = (1 - x) / 2;
        rule.w[i] = 1 / ((1 - x * x) * slope * slope);
    }
    return rule;
}

}  // namespace volillum
