// How a light's photons are born: on the box of the medium, or at the light itself.
#pragma once

#include "photon_math.h"
#include "volillum/photons.h"

namespace volillum {

// The lattice in padded voxel coordinates q = index + 1, and the box of q that holds the medium.
struct PhotonGeometry {
    PhotonGeometry(const double *index_to_world, const Size3 &shape);

    Lattice lattice;
    Size3 shape;
    std::array<Vec3, 3> columns;  // world vectors of the index axes
    Vec3 origin;                  // world position of q = 0
    double voxel_volume, voxel_diagonal;

    Vec3 world(const Vec3 &q) const {
        return origin + (q[0] * columns[0] + (q[1] * columns[1] + q[2] * columns[2]));
    }
};

struct Box {
    Vec3 low, high;  // q
};

struct Birth {
    Vec3 position;       // q
    float direction[3];  // of flight, world
    float weight[3];     // power over PhotonEmitter::power, at most 3
};

class PhotonEmitter {
public:
    // `source` and `geometry` must outlive the emitter.
    PhotonEmitter(const PhotonSource &source, const PhotonGeometry &geometry, const Box &box);

    // False where the photon misses the box for certain (its power is still that of `birth`).
    bool emit(Random &random, Birth &birth) const;

    // Power of a photon of weight 1, over the number of photons.
    double power;

private:
    struct Cone {
        Vec3 axis;
        double drop;  // 1 - cosine of the half angle: 2 is the whole sphere
        Vec3 draw(Random &random) const;
        double solid_angle() const { return 2.0 * M_PI * drop; }
    };
    Cone toward_box(const Vec3 &point) const;
    bool from_outside(const Vec3 &flight, Random &random, Birth &birth) const;
    bool from_image(Random &random, Birth &birth) const;
    bool from_point(Random &random, Birth &birth) const;
    bool from_area(Random &random, Birth &birth) const;
    bool from_emission(Random &random, Birth &birth) const;
    bool enter(const Vec3 &point, const Vec3 &flight, Birth &birth) const;

    const PhotonSource &source_;
    const PhotonGeometry &geometry_;
    Box box_;
    Vec3 centre_;
    double radius_, widest_;  // of the box: bounding sphere, bound of the projected area
    Cone cone_{};             // of a distant light, point or spot
};

}  // namespace volillum
