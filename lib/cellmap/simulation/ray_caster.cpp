#include "cellmap/simulation/ray_caster.hpp"

#include <embree3/rtcore.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "cellmap/core/error.hpp"
#include "cellmap/core/parallel.hpp"

namespace cellmap::simulation {
namespace {

/// Rays handed to Embree at once; fixed, so that the thread count cannot change a result.
constexpr std::size_t kBatch = 1024;

void throw_on_error(RTCDevice device, const char* what) {
  const RTCError error = rtcGetDeviceError(device);
  if (error == RTC_ERROR_NONE) return;
  throw Error(error == RTC_ERROR_OUT_OF_MEMORY ? ErrorCode::kTooLarge : ErrorCode::kInternal,
              std::string("ray casting failed while ") + what + " (Embree error " +
                  std::to_string(static_cast<int>(error)) + ")");
}

/// A scene that is released with its owner.
class Scene {
 public:
  explicit Scene(RTCDevice device) : scene_(rtcNewScene(device)) {
    // Watertight: no ray slips between two triangles that share an edge.
    rtcSetSceneFlags(scene_, RTC_SCENE_FLAG_ROBUST);
  }
  ~Scene() { rtcReleaseScene(scene_); }
  Scene(const Scene&) = delete;
  Scene& operator=(const Scene&) = delete;
  RTCScene get() const { return scene_; }

 private:
  RTCScene scene_;
};

}  // namespace

class RayMesh {
 public:
  RayMesh(RTCDevice device, TriangleMesh mesh) : mesh_(std::move(mesh)), scene_(device) {
    if (!mesh_.triangles.empty()) attach(device);
    rtcCommitScene(scene_.get());
    throw_on_error(device, "building a mesh");
  }
  RTCScene scene() const { return scene_.get(); }
  const TriangleMesh& triangles() const { return mesh_; }

  /// Where the ray meets the plane of one triangle, in double.
  RayCaster::Hit refined(std::uint32_t triangle, const Eigen::Vector3d& origin,
                         const Eigen::Vector3d& direction, double embree_range_m) const {
    const auto& corners = mesh_.triangles[triangle];
    const auto corner = [&](std::size_t k) {
      const auto& v = mesh_.vertices[corners[k]];
      return Eigen::Vector3d(v[0], v[1], v[2]);
    };
    const Eigen::Vector3d a = corner(0);
    const Eigen::Vector3d normal = (corner(1) - a).cross(corner(2) - a).normalized();
    const double cosine = normal.dot(direction), range_m = normal.dot(a - origin) / cosine;
    // On a triangle seen edge-on the division says nothing; Embree's own range stands.
    const bool close = std::abs(range_m - embree_range_m) < 0.01;
    return {close ? range_m : embree_range_m, std::min(1.0, std::abs(cosine))};
  }

 private:
  void attach(RTCDevice device) {
    // Embree reads vertices sixteen bytes at a time: one more, which no triangle uses, ends the
    // array.
    mesh_.vertices.push_back({0, 0, 0});
    RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
    rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                               mesh_.vertices.data(), 0, sizeof(mesh_.vertices[0]),
                               mesh_.vertices.size() - 1);
    rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                               mesh_.triangles.data(), 0, sizeof(mesh_.triangles[0]),
                               mesh_.triangles.size());
    rtcCommitGeometry(geometry);
    rtcAttachGeometry(scene_.get(), geometry);
    rtcReleaseGeometry(geometry);
  }

  TriangleMesh mesh_;
  Scene scene_;
};

const TriangleMesh& triangles_of(const RayMesh& mesh) { return mesh.triangles(); }

struct RayCaster::Device {
  RTCDevice handle = rtcNewDevice("threads=1,set_affinity=0");
  Device() {
    if (handle == nullptr) throw_on_error(nullptr, "starting");
  }
  ~Device() {
    if (handle != nullptr) rtcReleaseDevice(handle);
  }
  Device(const Device&) = delete;
  Device& operator=(const Device&) = delete;
};

RayCaster::RayCaster() : device_(std::make_unique<Device>()) {}
RayCaster::~RayCaster() = default;
RayCaster::RayCaster(RayCaster&&) noexcept = default;
RayCaster& RayCaster::operator=(RayCaster&&) noexcept = default;

std::shared_ptr<const RayMesh> RayCaster::build(TriangleMesh mesh) const {
  return std::make_shared<RayMesh>(device_->handle, std::move(mesh));
}

namespace {

void attach_instance(RTCDevice device, RTCScene scene, const RayCaster::Instance& instance,
                     unsigned int id) {
  RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_INSTANCE);
  rtcSetGeometryInstancedScene(geometry, instance.mesh->scene());
  const Eigen::Matrix<float, 3, 4> rows = instance.T_world_mesh.matrix().topRows<3>().cast<float>();
  rtcSetGeometryTransform(geometry, 0, RTC_FORMAT_FLOAT3X4_COLUMN_MAJOR, rows.data());
  rtcCommitGeometry(geometry);
  rtcAttachGeometryByID(scene, geometry, id);
  rtcReleaseGeometry(geometry);
}

RTCRayHit ray_from(const Eigen::Vector3f& origin, const Eigen::Vector3f& direction,
                   float max_range) {
  RTCRayHit ray{};
  ray.ray.org_x = origin.x();
  ray.ray.org_y = origin.y();
  ray.ray.org_z = origin.z();
  ray.ray.dir_x = direction.x();
  ray.ray.dir_y = direction.y();
  ray.ray.dir_z = direction.z();
  ray.ray.tfar = max_range;
  ray.ray.mask = ~0u;
  ray.hit.geomID = ray.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
  return ray;
}

}  // namespace

void RayCaster::cast(std::span<const Instance> instances, const Eigen::Isometry3d& T_world_sensor,
                     std::span<const Eigen::Vector3f> directions, double max_range_m, int threads,
                     std::span<Hit> hits) const {
  const Scene scene(device_->handle);
  for (std::size_t i = 0; i < instances.size(); ++i) {
    attach_instance(device_->handle, scene.get(), instances[i], static_cast<unsigned int>(i));
  }
  rtcCommitScene(scene.get());
  throw_on_error(device_->handle, "placing meshes");
  const Eigen::Vector3d origin = T_world_sensor.translation();
  std::vector<Eigen::Isometry3d> T_mesh_world;
  for (const Instance& instance : instances)
    T_mesh_world.push_back(instance.T_world_mesh.inverse());

  parallel_for(directions.size(), kBatch, threads, [&](std::size_t begin, std::size_t end) {
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
    for (std::size_t i = begin; i < end; ++i) {
      const Eigen::Vector3d direction = T_world_sensor.linear() * directions[i].cast<double>();
      RTCRayHit ray =
          ray_from(origin.cast<float>(), direction.cast<float>(), static_cast<float>(max_range_m));
      rtcIntersect1(scene.get(), &context, &ray);
      hits[i] = {};
      if (ray.hit.geomID == RTC_INVALID_GEOMETRY_ID) continue;
      const unsigned int hit = ray.hit.instID[0];
      const Eigen::Isometry3d& T = T_mesh_world[hit];
      hits[i] = instances[hit].mesh->refined(ray.hit.primID, T * origin, T.linear() * direction,
                                             ray.ray.tfar);
    }
  });
}

}  // namespace cellmap::simulation
