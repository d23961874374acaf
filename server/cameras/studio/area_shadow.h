// Soft shadows of the person on the floor and the walls: of the key lamp and the panels as areas, and of
// reflected light. Each lamp is several points and reflected light several directions; each point's shadow is
// drawn, and what a place loses is the share of the points that it does not see.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "server/cameras/studio/body_mesh.h"
#include "server/cameras/studio/body_raster.h"
#include "server/cameras/studio/room.h"

namespace kinevox::studio {

class AreaShadow {
  public:
    // `room` must outlive it.
    explicit AreaShadow(const Room& room);

    // The shadow of the surface whose vertices are in the world.
    void cast(const TriangleMesh& surface, const std::vector<Vec3f>& vertices);

    // Factors on the sensor values of one row of a view, `count` pixels from `first`: bgr values are
    // multiplied in place.
    void darken(const RoomView& view, std::size_t first, int count, std::uint16_t* bgr) const;

  private:
    static constexpr int kFaces = 6;
    struct Light {
        const Lamp* lamp;           // null: reflected light
        std::vector<Vec3f> points;  // of the lamp, world; directions to reflected light, in the face's frame
    };
    // One face of the shell, in cells of its u, v.
    struct Plane {
        float cell_m = 0.03f;
        int wide = 0, high = 0;
        std::vector<std::vector<std::uint8_t>> hidden;  // per light: points that a cell does not see
        std::vector<std::uint16_t> mark;                // the last point that hid a cell
        std::vector<Vec3f> factor;
        CellBounds dark;
    };
    void add_point(Plane& plane, int face, std::size_t light, const Vec3f* lamp, Vec3f direction,
                   std::uint16_t number, const TriangleMesh& surface);
    void project(int face, const Vec3f* lamp, Vec3f direction, float cell_m);
    void finish(Plane& plane, int face);
    void smooth(Plane& plane, std::size_t light) const;

    const Room& room_;
    std::vector<Light> lights_;
    std::array<Plane, kFaces> planes_;
    const std::vector<Vec3f>* vertices_ = nullptr;
    std::vector<Vec3f> seen_;  // of the face being drawn: cells, and 1 in z if the point casts a shadow there
    mutable std::vector<std::uint16_t> scratch_;
};

}  // namespace kinevox::studio
