#include "lights.h"

#include <algorithm>

namespace volillum::exact {

namespace {

constexpr double pi = std::numbers::pi;

Frame frame_about(const Vec3 &direction) {
    const double norm = length(direction);
    return Frame(norm > 0.0 ? (1.0 / norm) * direction : Vec3{0.0, 0.0, 1.0});
}

}  // namespace

LightSource::LightSource(const Light &light)
    : light_(light),
      frame_(frame_about(light.direction)),
      solid_angle_(2.0 * pi * (1.0 - light.cos_angle)),
      is_black_(!(largest(light.colour) > 0.0)) {
    if (light.kind != Light::Kind::image) return;
    double sum = 0.0;
    for (std::size_t i = 0; i < light.height * light.width; ++i) {
        const Vec3 radiance = pixel_radiance(i);
        sum += (radiance[0] + radiance[1] + radiance[2]) * pixel_solid_angle(i / light.width);
        cumulative_.push_back(sum);
    }
    is_black_ = !(sum > 0.0);
    for (double &value : cumulative_) value /= sum;
}

double LightSource::shape(double cosine) const {
    if (light_.shape == Light::Shape::point) return 1.0;
    if (light_.shape == Light::Shape::flat) return std::max(cosine, 0.0);
    if (!(cosine > light_.cos_angle)) return 0.0;
    if (!(light_.blend > 0.0)) return 1.0;
    const double ramp = std::min((cosine - light_.cos_angle) / light_.blend, 1.0);
    return ramp * ramp * (3.0 - 2.0 * ramp);
}

Vec3 LightSource::pixel_radiance(std::size_t pixel) const {
    const double *p = light_.image + 3 * pixel;
    return {p[0], p[1], p[2]};
}

double LightSource::pixel_solid_angle(std::size_t row) const {
    const double step = pi / double(light_.height), top = pi / 2.0 - double(row) * step;
    return (std::sin(top) - std::sin(top - step)) * 2.0 * pi / double(light_.width);
}

std::size_t LightSource::pixel(const Vec3 &direction) const {
    const auto &turn = light_.rotation;
    const double x = dot(turn[0], direction), y = dot(turn[1], direction),
                 z = std::clamp(dot(turn[2], direction), -1.0, 1.0);
    const auto place = [](double share, std::size_t count) {
        return std::size_t(std::clamp(share * double(count), 0.0, double(count) - 0.5));
    };
    const std::size_t row = place(0.5 - std::asin(z) / pi, light_.height);
    return row * light_.width + place(0.5 - std::atan2(y, x) / (2.0 * pi), light_.width);
}

LightSample LightSource::sample_distant(Random &random) const {
    constexpr double infinity = std::numeric_limits<double>::infinity();
    if (light_.kind == Light::Kind::distant) {
        const double u = random.next(), v = random.next();
        return {frame_.cone(light_.cos_angle, u, v), infinity, light_.colour,
                solid_angle_ > 0.0 ? 1.0 / solid_angle_ : 0.0};
    }
    const auto found = std::upper_bound(cumulative_.begin(), cumulative_.end(), random.next());
    const std::size_t i =
        std::min(std::size_t(found - cumulative_.begin()), cumulative_.size() - 1);
    const std::size_t row = i / light_.width, column = i % light_.width;
    const double step = pi / double(light_.height), top = pi / 2.0 - double(row) * step;
    const double high = std::sin(top), low = std::sin(top - step);
    const double z = high + random.next() * (low - high);
    const double azimuth =
        2.0 * pi * (0.5 - (double(column) + random.next()) / double(light_.width));
    const double radial = std::sqrt(std::max(0.0, 1.0 - z * z));
    const Vec3 local = {radial * std::cos(azimuth), radial * std::sin(azimuth), z};
    Vec3 direction{};  // the rotation's transpose is its inverse
    for (std::size_t a = 0; a < 3; ++a) direction = direction + local[a] * light_.rotation[a];
    const double chance = cumulative_[i] - (i > 0 ? cumulative_[i - 1] : 0.0);
    if (!(chance > 0.0)) return {};
    const double density = chance / pixel_solid_angle(row);
    return {direction, infinity, (1.0 / density) * pixel_radiance(i), density};
}

Vec3 LightSource::radiance(const Vec3 &direction, double &density) const {
    density = 0.0;
    switch (light_.kind) {
        case Light::Kind::constant:
            return light_.colour;
        case Light::Kind::distant:
            if (!(solid_angle_ > 0.0) || dot(frame_.z, direction) < light_.cos_angle) return {};
            density = 1.0 / solid_angle_;
            return density * light_.colour;
        case Light::Kind::image: {
            if (is_black_) return {};
            const std::size_t i = pixel(direction);
            const double chance = cumulative_[i] - (i > 0 ? cumulative_[i - 1] : 0.0);
            density = chance / pixel_solid_angle(i / light_.width);
            return pixel_radiance(i);
        }
        case Light::Kind::lamp:
            break;
    }
    return {};
}

}  // namespace volillum::exact
