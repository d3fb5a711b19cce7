// Made tiles_half_zip.vdb, inactive_double_blosc.vdb and several_none.vdb with OpenVDB 10.0.1 (Debian 12):
//   apt install libopenvdb-dev libtbb-dev libimath-dev && g++ -std=c++17 make_fixtures.cc -lopenvdb -ltbb -lImath-3_1
// test_vdb.py knows the same closed forms, so the tests need no OpenVDB.
#include <openvdb/openvdb.h>
#include <openvdb/tools/LevelSetSphere.h>
using namespace openvdb;

static double value(int x, int y, int z) { return (((x * 7 + y * 13 + z * 29) & 63) + 1) / 64.0; }

template <class G> static typename G::Ptr grid(const char* name, bool fog) {
    auto made = G::create();
    made->setName(name);
    if (fog) made->setGridClass(GRID_FOG_VOLUME);
    made->setTransform(math::Transform::createLinearTransform(0.125));
    made->transform().postTranslate(Vec3d(1.5, -2.25, 0.5));
    return made;
}

static void write(const char* file, uint32_t compression, GridPtrVec grids) {
    io::File out(file);
    out.setCompression(compression);
    out.write(grids);
}

int main() {
    initialize();
    {  // an active tile of 128^3, an inactive one of 8^3, active ones of 8^3, and voxels; no class, so zip is used
        auto g = grid<FloatGrid>("density", false);
        g->setSaveFloatAsHalf(true);
        g->fill(CoordBBox(Coord(-128, 0, 0), Coord(-1, 127, 127)), 0.5f, true);
        g->fill(CoordBBox(Coord(0, 0, 0), Coord(31, 15, 7)), 1.25f, true);
        g->fill(CoordBBox(Coord(0, 32, 0), Coord(7, 39, 7)), 0.75f, false);
        for (int x = -20; x < 20; ++x) for (int y = -9; y < -2; ++y) for (int z = 3; z < 20; ++z)
            g->getAccessor().setValue(Coord(x, y, z), float(value(x, y, z)));
        write("tiles_half_zip.vdb", io::COMPRESS_ZIP | io::COMPRESS_ACTIVE_MASK, {g});
    }
    {  // a third of the voxels is active; the others of leaf k have one, two (0 among them or not) or many values
        auto g = grid<DoubleGrid>("density", true);
        for (int x = 64; x < 96; ++x) for (int y = 0; y < 8; ++y) for (int z = -8; z < 0; ++z) {
            const int n = (x + y + z) & 3, leaf = (x - 64) / 8;
            const double inactive = leaf == 0 ? 0.3125 : leaf == 1 ? 0.25 * (n & 2) : leaf == 2 ? 1.0 + (n & 2) : 0.125 * y;
            if (n == 0) g->getAccessor().setValue(Coord(x, y, z), value(x, y, z) / 3.0);
            else g->getAccessor().setValueOff(Coord(x, y, z), inactive);
        }
        write("inactive_double_blosc.vdb", io::COMPRESS_BLOSC | io::COMPRESS_ACTIVE_MASK, {g});
    }
    {  // what one file may hold
        auto unnamed = grid<FloatGrid>("", true), flame = grid<FloatGrid>("flame", true);
        for (int x = 2; x < 12; ++x) unnamed->getAccessor().setValue(Coord(x, 2 * x, 20 - x), float(value(x, 2 * x, 20 - x)));
        auto shared = gridPtrCast<FloatGrid>(unnamed->copy());
        shared->setName("shared");
        shared->setTransform(math::Transform::createLinearTransform(2.0));
        auto surface = tools::createLevelSetSphere<FloatGrid>(2.f, Vec3f(4, 4, 4), .5f);
        surface->setName("surface");
        auto vel = Vec3SGrid::create(Vec3s(0));
        vel->setName("vel");
        vel->setGridClass(GRID_STAGGERED);
        vel->getAccessor().setValue(Coord(1, 2, 3), Vec3s(1, 2, 3));
        auto turned = gridPtrCast<FloatGrid>(unnamed->copy());
        turned->setName("turned");
        turned->setTransform(unnamed->transform().copy());
        turned->transform().preRotate(0.3, math::Z_AXIS);
        auto frustum = gridPtrCast<FloatGrid>(unnamed->copy());
        frustum->setName("frustum");
        frustum->setTransform(math::Transform::createFrustumTransform(BBoxd(Vec3d(0), Vec3d(10)), .5, 1., 1.));
        write("several_none.vdb", io::COMPRESS_ACTIVE_MASK, {unnamed, flame, shared, surface, vel, turned, frustum});
    }
}
