// Procedural surfaces of the room, in metres on a face.
#pragma once

#include <cstdint>
#include <vector>

#include "server/cameras/studio/subject.h"

namespace kinevox::studio {

enum class TextureKind {
    kPaint,
    kBrick,
    kPanelling,
    kWoodFloor,
    kConcrete,
    kTrack,
    kCeiling,
    kShelf,
    kCabinet,
    kWood,
    kCrate,
    kScreen,
    kLamp,
    kMat
};

struct Texture {
    TextureKind kind = TextureKind::kPaint;
    Albedo base;
    std::uint32_t seed = 0;
};

enum class DecalKind { kPoster, kWhiteboard, kDoor, kTape, kLaneLine, kLampPanel };

// A rectangle painted on a face.
struct Decal {
    DecalKind kind;
    float u0, v0, u1, v1;  // m
    Albedo base;
    std::uint32_t seed = 0;
};

// Linear reflectance at (u, v); of a lamp or lamp panel its brightness.
Albedo texture_at(const Texture& texture, float u, float v, float u_length, float v_length);
Albedo decal_at(const Decal& decal, float u, float v);

}  // namespace kinevox::studio
