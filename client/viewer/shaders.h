// GLSL 3.30 programs of the scene.
#pragma once

namespace kinevox::viewer {

// One square per surface voxel at its projected size, lit from the eye's upper left.
inline constexpr const char* kSurfaceVertex = R"(#version 330 core
layout(location = 0) in vec3 at;
layout(location = 1) in vec4 colour;
layout(location = 2) in vec3 normal;
uniform mat4 eye_from_world, clip_from_eye;
uniform float pixels_per_metre, voxel_m, min_light;
uniform vec4 tint;  // alpha: its share
out vec3 shade;
void main() {
    vec4 eye = eye_from_world * vec4(at, 1);
    gl_Position = clip_from_eye * eye;
    // The projection of a cube is wider than its edge.
    gl_PointSize = max(1.0, 1.35 * voxel_m * pixels_per_metre / max(0.05, -eye.z));
    float facing = dot(mat3(eye_from_world) * normalize(normal), normalize(vec3(-0.35, 0.45, 0.82)));
    shade = mix(colour.rgb, tint.rgb, tint.a) * mix(min_light, 1.12, 0.5 + 0.5 * facing);
})";
inline constexpr const char* kSurfaceFragment = R"(#version 330 core
in vec3 shade;
out vec4 result;
void main() { result = vec4(shade, 1); })";

inline constexpr const char* kFlatVertex = R"(#version 330 core
layout(location = 0) in vec3 at;
layout(location = 1) in vec4 colour;
uniform mat4 clip_from_world;
out vec4 shade;
void main() {
    gl_Position = clip_from_world * vec4(at, 1);
    shade = colour;
})";
inline constexpr const char* kFlatFragment = R"(#version 330 core
in vec4 shade;
out vec4 result;
void main() { result = shade; })";

// A camera's image at the end of its frustum; corners in the order of a triangle strip.
inline constexpr const char* kImageVertex = R"(#version 330 core
uniform mat4 clip_from_world;
uniform vec3 corner[4];
out vec2 where;
void main() {
    where = vec2(gl_VertexID & 1, gl_VertexID >> 1);
    gl_Position = clip_from_world * vec4(corner[gl_VertexID], 1);
})";
inline constexpr const char* kImageFragment = R"(#version 330 core
in vec2 where;
out vec4 result;
uniform sampler2D image;
void main() { result = vec4(texture(image, where).rgb, 1); })";

}  // namespace kinevox::viewer
