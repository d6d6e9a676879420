// SPDX-License-Identifier: MIT
#include "scene/read_vrml.hpp"

#include <stdexcept>

#ifdef PGL_SCENE_COIN

#include <Inventor/SbMatrix.h>
#include <Inventor/SoDB.h>
#include <Inventor/SoFullPath.h>
#include <Inventor/SoInput.h>
#include <Inventor/SoPrimitiveVertex.h>
#include <Inventor/VRMLnodes/SoVRMLAppearance.h>
#include <Inventor/VRMLnodes/SoVRMLCoordinate.h>
#include <Inventor/VRMLnodes/SoVRMLElevationGrid.h>
#include <Inventor/VRMLnodes/SoVRMLIndexedFaceSet.h>
#include <Inventor/VRMLnodes/SoVRMLIndexedLineSet.h>
#include <Inventor/VRMLnodes/SoVRMLPointSet.h>
#include <Inventor/VRMLnodes/SoVRMLShape.h>
#include <Inventor/actions/SoCallbackAction.h>
#include <Inventor/errors/SoReadError.h>
#include <Inventor/nodes/SoSeparator.h>
#include <Inventor/nodes/SoShape.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstring>
#include <map>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace pgl::scene {
namespace {

/// Throws where an index names no point: Coin does not look.
void check_indices(const SoVRMLIndexedFaceSet& faces) {
  const SoNode* coordinates = faces.coord.getValue();
  int points = 0;
  if (coordinates && coordinates->isOfType(SoVRMLCoordinate::getClassTypeId()))
    points = static_cast<const SoVRMLCoordinate*>(coordinates)->point.getNum();
  const std::int32_t* index = faces.coordIndex.getValues(0);
  for (int i = 0; i < faces.coordIndex.getNum(); ++i)
    if (index[i] >= points || index[i] < -1) throw std::runtime_error("a vertex index is out of range");
}

void check_heights(const SoVRMLElevationGrid& grid) {
  const std::int64_t columns = grid.xDimension.getValue(), rows = grid.zDimension.getValue();
  if (columns < 0 || rows < 0 || columns > INT32_MAX || rows > INT32_MAX || columns * rows > grid.height.getNum())
    throw std::runtime_error("an elevation grid has too few heights");
}

/// Collects triangles by object while Coin walks through the scene.
class Collector {
 public:
  FileContent content;

  SoCallbackAction::Response begin(const SoCallbackAction& action, const SoNode& shape) {
    static const std::array<const char*, 6> surfaces = {"VRMLBox",      "VRMLSphere",    "VRMLCone",
                                                        "VRMLCylinder", "VRMLExtrusion", "VRMLElevationGrid"};
    if (shape.isOfType(SoVRMLShape::getClassTypeId())) return SoCallbackAction::CONTINUE;  // what holds the geometry
    const std::string type = shape.getTypeId().getName().getString();
    if (shape.isOfType(SoVRMLIndexedLineSet::getClassTypeId()) || shape.isOfType(SoVRMLPointSet::getClassTypeId())) {
      ++content.points_and_lines;
      return SoCallbackAction::PRUNE;
    }
    if (type == "VRMLText") return SoCallbackAction::PRUNE;
    if (shape.isOfType(SoVRMLIndexedFaceSet::getClassTypeId())) {
      check_indices(static_cast<const SoVRMLIndexedFaceSet&>(shape));
    } else if (shape.isOfType(SoVRMLElevationGrid::getClassTypeId())) {
      check_heights(static_cast<const SoVRMLElevationGrid&>(shape));
    } else if (std::find(surfaces.begin(), surfaces.end(), type) == surfaces.end()) {
      throw std::runtime_error("has a shape that VRML 2.0 does not know: " + type);
    }
    mesh_ = mesh_of(action);
    const auto* ccw = static_cast<const SoSFBool*>(shape.getField("ccw"));
    clockwise_ = ccw && ccw->isOfType(SoSFBool::getClassTypeId()) && !ccw->getValue();
    return SoCallbackAction::CONTINUE;
  }

  void add(const SoPrimitiveVertex& a, const SoPrimitiveVertex& b, const SoPrimitiveVertex& c) {
    MeshData& mesh = content.meshes[mesh_];
    const auto first = static_cast<std::uint32_t>(mesh.positions.size());
    if (first >= (std::uint32_t{1} << 31) - 3) throw std::runtime_error("a mesh has 2^31 or more vertices");
    for (const SoPrimitiveVertex* v : {&a, &b, &c}) {
      const SbVec3f& p = v->getPoint();
      mesh.positions.emplace_back(p[0], p[1], p[2]);
    }
    mesh.triangles.push_back({{first, first + 1, first + 2}});
    if (clockwise_) std::swap(mesh.triangles.back().v[1], mesh.triangles.back().v[2]);
  }

 private:
  using Matrix = std::array<float, 16>;
  /// The way to the grouping node, the material, and the transform there: what shapes of one object have in common.
  using Key = std::pair<std::vector<std::pair<const SoNode*, int>>, Matrix>;

  /// The material of the shape at `at` in the path, or null.
  static const SoNode* material_of(const SoFullPath& path, int at) {
    const SoNode* shape = path.getNode(at);
    if (!shape->isOfType(SoVRMLShape::getClassTypeId())) return nullptr;
    const SoNode* appearance = static_cast<const SoVRMLShape*>(shape)->appearance.getValue();
    if (!appearance || !appearance->isOfType(SoVRMLAppearance::getClassTypeId())) return nullptr;
    return static_cast<const SoVRMLAppearance*>(appearance)->material.getValue();
  }

  std::size_t mesh_of(const SoCallbackAction& action) {
    const SoPath& path = *const_cast<SoCallbackAction&>(action).getCurPath();
    const auto& full = static_cast<const SoFullPath&>(path);
    int end = full.getLength() - 1;
    if (end > 0 && full.getNode(end - 1)->isOfType(SoVRMLShape::getClassTypeId())) --end;
    key_.first.clear();
    for (int i = 0; i < end; ++i) key_.first.emplace_back(full.getNode(i), full.getIndex(i));
    key_.first.emplace_back(material_of(full, end), 0);
    const SbMatrix matrix = action.getModelMatrix();
    std::memcpy(key_.second.data(), matrix[0], sizeof key_.second);
    const auto [entry, is_new] = known_.try_emplace(key_, content.meshes.size());
    if (is_new) {
      content.meshes.emplace_back();
      FileObject object{static_cast<std::uint32_t>(entry->second), {}, {}};
      for (int row = 0; row < 4; ++row)
        for (int column = 0; column < 3; ++column) object.transform[row][column] = matrix[row][column];
      if (end > 0) object.name = full.getNode(end - 1)->getName().getString();
      content.objects.push_back(std::move(object));
    }
    return entry->second;
  }

  std::map<Key, std::size_t> known_;
  Key key_;
  std::size_t mesh_ = 0;
  bool clockwise_ = false;
};

std::string first_complaint;

/// What Coin says, on one line and without its name.
std::string on_one_line(const std::string& text) {
  constexpr std::string_view name = "Coin read error: ";
  std::string line;
  for (const char c : text.starts_with(name) ? text.substr(name.size()) : text) {
    const bool blank = static_cast<unsigned char>(c) <= ' ';
    if (!blank || (!line.empty() && line.back() != ' ')) line.push_back(blank ? ' ' : c);
  }
  return line;
}

}  // namespace

FileContent read_vrml(const std::filesystem::path& file) {
  SoDB::init();
  SoReadError::setHandlerCallback(
      [](const SoError* error, void*) {
        if (first_complaint.empty()) first_complaint = error->getDebugString().getString();
      },
      nullptr);
  SoInput input;
  if (!input.openFile(file.c_str())) throw std::runtime_error("cannot be opened");
  SoSeparator* scene = SoDB::readAll(&input);
  if (!first_complaint.empty()) throw std::runtime_error("cannot be read: " + on_one_line(first_complaint));
  if (!scene) throw std::runtime_error("cannot be read");
  scene->ref();  // and never given back: the process ends

  Collector collector;
  SoCallbackAction action;
  action.addPreCallback(
      SoShape::getClassTypeId(),
      [](void* data, SoCallbackAction* at, const SoNode* shape) {
        return static_cast<Collector*>(data)->begin(*at, *shape);
      },
      &collector);
  action.addTriangleCallback(
      SoShape::getClassTypeId(),
      [](void* data, SoCallbackAction*, const SoPrimitiveVertex* a, const SoPrimitiveVertex* b,
         const SoPrimitiveVertex* c) { static_cast<Collector*>(data)->add(*a, *b, *c); },
      &collector);
  action.apply(scene);

  // Objects without triangles, such as those of empty face sets, are left out.
  FileContent result;
  result.points_and_lines = collector.content.points_and_lines;
  for (FileObject& object : collector.content.objects) {
    MeshData& mesh = collector.content.meshes[object.mesh];
    if (mesh.triangles.empty()) continue;
    object.mesh = static_cast<std::uint32_t>(result.meshes.size());
    result.meshes.push_back(std::move(mesh));
    result.objects.push_back(std::move(object));
  }
  return result;
}

}  // namespace pgl::scene

#else

namespace pgl::scene {

FileContent read_vrml(const std::filesystem::path&) {
  throw std::runtime_error("VRML needs the library Coin (libcoin-dev), without which this program was built");
}

}  // namespace pgl::scene

#endif
