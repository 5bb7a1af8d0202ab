// The lights of full scattering: sampled at a point, and met by rays that leave the medium.
#pragma once

#include <vector>

#include "body.h"
#include "sampling.h"

namespace volillum::exact {

// One direction in which a light is seen from a point.
struct LightSample {
    Vec3 direction{};
    double distance = 0.0;
    Vec3 fluence{};        // radiance over the density of the choice
    double density = 0.0;  // per solid angle; 0: no ray can meet the light by chance
};

class LightSource {
public:
    explicit LightSource(const Light &light);

    // Whether it is sought from points (otherwise only met by rays, as light from everywhere is).
    bool is_sought() const { return light_.kind != Light::Kind::constant && !is_black_; }
    bool is_lamp() const { return light_.kind == Light::Kind::lamp; }
    double share() const { return light_.share; }

    // A point of the lamp.
    VOLILLUM_INLINE Vec3 lamp_point(Random &random) const {
        double u = 2.0 * random.next() - 1.0, v = 2.0 * random.next() - 1.0;
        if (light_.ellipse) {
            const double radius = std::sqrt(0.5 * (u + 1.0)), phi = std::numbers::pi * v;
            u = radius * std::cos(phi);
            v = radius * std::sin(phi);
        }
        return light_.position + u * light_.half_extent[0] + v * light_.half_extent[1];
    }
    // The lamp seen at `from`, where a point of it is.
    VOLILLUM_INLINE LightSample lamp(const Vec3 &point, const Vec3 &from) const {
        const Vec3 toward = from - point;
        const double distance = length(toward);
        if (!(distance > 0.0)) return {};
        LightSample sample{(1.0 / distance) * toward, distance, {}, 0.0};
        const double cosine = -dot(sample.direction, light_.direction);
        sample.fluence = (shape(cosine) / (distance * distance)) * light_.colour;
        return sample;
    }
    LightSample sample_distant(Random &random) const;

    // Radiance that a ray meets outside, and the density with which it would have been sought.
    Vec3 radiance(const Vec3 &direction, double &density) const;

private:
    double shape(double cosine) const;
    std::size_t pixel(const Vec3 &direction) const;
    Vec3 pixel_radiance(std::size_t pixel) const;
    double pixel_solid_angle(std::size_t row) const;

    const Light &light_;
    Frame frame_;
    double solid_angle_;  // of a sun's disc; 0: ideal
    bool is_black_;
    std::vector<double> cumulative_;  // of an image's pixels, from 0 to 1
};

}  // namespace volillum::exact
