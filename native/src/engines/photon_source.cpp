#include "photon_source.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace volillum {

namespace {

Vec3 cross(const Vec3 &a, const Vec3 &b) {
    return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
void set_direction(Birth &birth, const Vec3 &flight) {
    const double scale = 1.0 / length(flight);
    for (std::size_t a = 0; a < 3; ++a) birth.direction[a] = float(flight[a] * scale);
}
void set_weight(Birth &birth, double weight) {
    for (float &each : birth.weight) each = float(weight);
}

// Cycles' falloff: smoothstep of the cosine from the cone's edge inwards.
double spot_falloff(double cosine, double edge, double blend) {
    if (!(cosine > edge)) return 0.0;
    const double smooth = (1.0 - edge) * blend;
    const double ramp = smooth > 0.0 ? std::min((cosine - edge) / smooth, 1.0) : 1.0;
    return ramp * ramp * (3.0 - 2.0 * ramp);
}

}  // namespace

AliasTable::AliasTable(const std::vector<double> &weights) {
    for (const double weight : weights) total_ += weight;
    if (!(total_ > 0.0) || !std::isfinite(total_))
        throw std::invalid_argument("the weights of a table sum to " + std::to_string(total_) +
                                    "; expected a positive number");
    const std::size_t count = weights.size();
    entries_.resize(count);
    std::vector<double> scaled(count);
    std::vector<std::uint32_t> small, large;
    for (std::size_t i = 0; i < count; ++i) {
        scaled[i] = weights[i] * double(count) / total_;
        (scaled[i] < 1.0 ? small : large).push_back(std::uint32_t(i));
    }
    while (!small.empty() && !large.empty()) {
        const std::uint32_t less = small.back(), more = large.back();
        small.pop_back();
        entries_[less] = {float(scaled[less]), more};
        scaled[more] -= 1.0 - scaled[less];
        if (scaled[more] < 1.0) {
            large.pop_back();
            small.push_back(more);
        }
    }
    for (const std::uint32_t i : large) entries_[i] = {1.0f, i};
    // What rounding left here has a share of 1, unless its weight is 0.
    for (const std::uint32_t i : small) {
        const auto heaviest = std::max_element(weights.begin(), weights.end()) - weights.begin();
        entries_[i] = weights[i] > 0.0 ? Entry{1.0f, i} : Entry{0.0f, std::uint32_t(heaviest)};
    }
}

PhotonGeometry::PhotonGeometry(const double *m, const Size3 &size) : lattice(m), shape(size) {
    for (std::size_t a = 0; a < 3; ++a) columns[a] = {m[a], m[4 + a], m[8 + a]};
    origin = Vec3{m[3], m[7], m[11]} - (columns[0] + (columns[1] + columns[2]));
    voxel_volume = std::abs(dot(columns[0], cross(columns[1], columns[2])));
    voxel_diagonal = 0.0;
    for (const double u : {-1.0, 1.0})
        for (const double v : {-1.0, 1.0})
            voxel_diagonal =
                std::max(voxel_diagonal, length(columns[0] + (u * columns[1] + v * columns[2])));
}

PhotonEmitter::PhotonEmitter(const PhotonSource &source, const PhotonGeometry &geometry,
                             const Box &box)
    : source_(source), geometry_(geometry), box_(box) {
    const Vec3 extent = box.high - box.low;
    centre_ = geometry.world(0.5 * (box.low + box.high));
    radius_ = 0.0;
    for (const double x : {-0.5, 0.5})
        for (const double y : {-0.5, 0.5})
            radius_ = std::max(radius_, length(x * extent[0] * geometry.columns[0] +
                                               (y * extent[1] * geometry.columns[1] +
                                                0.5 * extent[2] * geometry.columns[2])));
    widest_ = 0.0;
    for (std::size_t a = 0; a < 3; ++a) {
        const std::size_t b = (a + 1) % 3, c = (a + 2) % 3;
        widest_ += extent[b] * extent[c] * length(cross(geometry.columns[b], geometry.columns[c]));
    }
    using Kind = PhotonSource::Kind;
    switch (source.kind) {
        case Kind::distant:
            cone_ = {source.direction, 1.0 - source.cos_half_angle};
            power = widest_;
            break;
        case Kind::environment:
            power = 4.0 * M_PI * widest_;
            break;
        case Kind::image:
            power = source.table.total() * widest_;
            break;
        case Kind::point:
            cone_ = toward_box(source.position);
            power = cone_.solid_angle();
            break;
        case Kind::spot: {
            const Cone all = toward_box(source.position);
            const Cone own{source.direction, 1.0 - source.cos_half_angle};
            cone_ = own.drop < all.drop ? own : all;
            power = cone_.solid_angle();
            break;
        }
        case Kind::area: {
            const double reach = length(source.half_axes[0]) + length(source.half_axes[1]);
            const double nearest = length(centre_ - source.position) - reach;
            const double sine = nearest > radius_ ? radius_ / nearest : 1.0;
            power =
                nearest > radius_ ? 2.0 * M_PI * (1.0 - std::sqrt(1.0 - sine * sine)) : 2.0 * M_PI;
            break;
        }
        case Kind::emission:
            power = 4.0 * M_PI * geometry.voxel_volume * source.table.total();
            break;
    }
}

Vec3 PhotonEmitter::Cone::draw(Random &random) const {
    const double below = drop * random.unit(), azimuth = 2.0 * M_PI * random.unit();
    const double cosine = 1.0 - below, sine = std::sqrt(std::max(0.0, below * (2.0 - below)));
    const double sign = axis[2] >= 0.0 ? 1.0 : -1.0, a = -1.0 / (sign + axis[2]),
                 b = axis[0] * axis[1] * a;
    const Vec3 first{1.0 + sign * axis[0] * axis[0] * a, sign * b, -sign * axis[0]},
        second{b, sign + axis[1] * axis[1] * a, -axis[1]};
    return cosine * axis + (sine * std::cos(azimuth) * first + sine * std::sin(azimuth) * second);
}

PhotonEmitter::Cone PhotonEmitter::toward_box(const Vec3 &point) const {
    const Vec3 away = centre_ - point;
    const double distance = length(away);
    if (!(distance > radius_)) return {{0.0, 0.0, 1.0}, 2.0};
    const double sine = radius_ / distance;
    // 1 - cos, without the cancellation of far lights.
    return {(1.0 / distance) * away, sine * sine / (1.0 + std::sqrt(1.0 - sine * sine))};
}

bool PhotonEmitter::emit(Random &random, Birth &birth) const {
    using Kind = PhotonSource::Kind;
    switch (source_.kind) {
        case Kind::distant:
            return from_outside(cone_.draw(random), random, birth);
        case Kind::environment:
            return from_outside(Cone{{0.0, 0.0, 1.0}, 2.0}.draw(random), random, birth);
        case Kind::image:
            return from_image(random, birth);
        case Kind::point:
        case Kind::spot:
            return from_point(random, birth);
        case Kind::area:
            return from_area(random, birth);
        case Kind::emission:
            return from_emission(random, birth);
    }
    return false;
}

// Uniform over the box's cross section: a face that the light sees, in proportion to its projected
// area, then a point of that face.
bool PhotonEmitter::from_outside(const Vec3 &flight, Random &random, Birth &birth) const {
    const Vec3 d = geometry_.lattice.vector(flight), extent = box_.high - box_.low;
    Vec3 area;
    for (std::size_t a = 0; a < 3; ++a)
        area[a] =
            std::abs(d[a]) * extent[(a + 1) % 3] * extent[(a + 2) % 3] * geometry_.voxel_volume;
    const double all = area[0] + area[1] + area[2];
    const double draw = random.unit() * all;
    const std::size_t axis = draw < area[0] ? 0 : draw < area[0] + area[1] ? 1 : 2;
    for (std::size_t a = 0; a < 3; ++a) {
        if (a == axis)
            birth.position[a] = d[a] > 0.0 ? box_.low[a] : box_.high[a];
        else
            birth.position[a] = box_.low[a] + extent[a] * random.unit();
    }
    set_direction(birth, flight);
    set_weight(birth, all / widest_);
    return true;
}

bool PhotonEmitter::from_image(Random &random, Birth &birth) const {
    const std::size_t pixel = source_.table.draw(random.unit());
    const std::size_t row = pixel / source_.width, column = pixel % source_.width;
    const auto edge = [&](std::size_t r) {
        return std::sin(M_PI * (0.5 - double(r) / double(source_.height)));
    };
    const double z = edge(row) + (edge(row + 1) - edge(row)) * random.unit();
    const double azimuth =
        2.0 * M_PI * (0.5 - (double(column) + random.unit()) / double(source_.width));
    const double sine = std::sqrt(std::max(0.0, 1.0 - z * z));
    const Vec3 local{sine * std::cos(azimuth), sine * std::sin(azimuth), z};
    Vec3 flight;  // minus the transpose of the rotation times the image's direction
    for (std::size_t a = 0; a < 3; ++a)
        flight[a] = -(source_.rotation[0][a] * local[0] + source_.rotation[1][a] * local[1] +
                      source_.rotation[2][a] * local[2]);
    from_outside(flight, random, birth);
    if (source_.coloured())
        for (std::size_t c = 0; c < 3; ++c) birth.weight[c] *= source_.colours[3 * pixel + c];
    return true;
}

bool PhotonEmitter::from_point(Random &random, Birth &birth) const {
    const Vec3 flight = cone_.draw(random);
    double weight = 1.0;
    if (source_.kind == PhotonSource::Kind::spot)
        weight =
            spot_falloff(dot(flight, source_.direction), source_.cos_half_angle, source_.blend);
    set_weight(birth, weight);
    return enter(source_.position, flight, birth) && weight > 0.0;
}

bool PhotonEmitter::from_area(Random &random, Birth &birth) const {
    double u = 2.0 * random.unit() - 1.0, v = 2.0 * random.unit() - 1.0;
    if (source_.ellipse) {
        const double radius = std::sqrt(0.5 * (u + 1.0)), azimuth = M_PI * v;
        u = radius * std::cos(azimuth);
        v = radius * std::sin(azimuth);
    }
    const Vec3 point = source_.position + (u * source_.half_axes[0] + v * source_.half_axes[1]);
    Cone cone = toward_box(point);
    if (cone.drop > 1.0) cone = {source_.direction, 1.0};  // inside: the lit half space
    const Vec3 flight = cone.draw(random);
    const double cosine = std::max(0.0, dot(flight, source_.direction));
    set_weight(birth, cosine * cone.solid_angle() / power);
    return enter(point, flight, birth) && cosine > 0.0;
}

// Voxel i shines as the hat function that interpolates it: the sum of two uniforms.
bool PhotonEmitter::from_emission(Random &random, Birth &birth) const {
    const std::size_t voxel = source_.table.draw(random.unit());
    const Size3 &n = geometry_.shape;
    const Size3 index = {voxel / (n[1] * n[2]), voxel / n[2] % n[1], voxel % n[2]};
    Vec3 point;
    for (std::size_t a = 0; a < 3; ++a) point[a] = double(index[a]) + random.unit() + random.unit();
    const Vec3 flight = Cone{{0.0, 0.0, 1.0}, 2.0}.draw(random);
    set_weight(birth, 1.0);
    if (source_.coloured()) {
        const float *const red = source_.emission.values + voxel;
        const std::size_t voxels = n[0] * n[1] * n[2];
        const double mean = (double(red[0]) + double(red[voxels]) + double(red[2 * voxels])) / 3.0;
        for (std::size_t c = 0; c < 3; ++c) birth.weight[c] = float(red[c * voxels] / mean);
    }
    set_direction(birth, flight);
    birth.position = point;
    return true;
}

// Starts at the world point when it is in the box, otherwise where the flight enters it.
bool PhotonEmitter::enter(const Vec3 &point, const Vec3 &flight, Birth &birth) const {
    const Vec3 q = geometry_.lattice.point(point), d = geometry_.lattice.vector(flight);
    double begin = 0.0, end = INFINITY;
    for (std::size_t a = 0; a < 3; ++a) {
        if (d[a] == 0.0) {
            if (q[a] < box_.low[a] || q[a] > box_.high[a]) end = -1.0;
            continue;
        }
        const double s = (box_.low[a] - q[a]) / d[a], t = (box_.high[a] - q[a]) / d[a];
        begin = std::max(begin, std::min(s, t));
        end = std::min(end, std::max(s, t));
    }
    set_direction(birth, flight);
    birth.position = q + std::max(0.0, begin) * d;
    return begin < end;
}

}  // namespace volillum
