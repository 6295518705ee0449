// Traces the rays of a folder that `lanternd bench --dump` wrote, with Embree 3, and prints how fast, and whether it hits what we
// hit, as JSON. run.py builds it and says how it is used.
//
//   trace FOLDER THREADS SECONDS medium|high KIND:closest|any:FIRST_TRIANGLE:TRIANGLES…
//
// Each kind is traced by single rays (rtcIntersect1 where the nearest hit is asked for, rtcOccluded1 where any is) and by packets of
// sixteen neighbours of the file with the flag for coherent rays, for at least SECONDS each, after one pass that is not timed. What is
// timed is loading a ray from memory, tracing it, and writing down what it hit. Threads take 1,024 rays at a time.
#include <embree3/rtcore.h>
#include <immintrin.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <functional>
#include <limits>
#include <string>
#include <thread>
#include <vector>

namespace {

constexpr uint32_t NOTHING = 0xffffffffu;
// Two tracers' distances are the same where they differ by less than this share of them, or of a metre.
constexpr float SAME = 1e-4f;
constexpr size_t CHUNK = 1024;

struct Ray {
    float origin[3];
    float t_min;
    float direction[3];
    float t_max;
};

struct Hit {
    float t;
    uint32_t triangle;
};

[[noreturn]] void fail(const std::string& why) {
    std::fprintf(stderr, "trace: %s\n", why.c_str());
    std::exit(1);
}

template <typename T>
std::vector<T> read(const std::string& path) {
    std::ifstream file(path, std::ios::binary | std::ios::ate);
    if (!file) fail("cannot read " + path);
    const auto bytes = static_cast<size_t>(file.tellg());
    if (bytes % sizeof(T) != 0) fail(path + " has not a whole number of entries");
    std::vector<T> all(bytes / sizeof(T));
    file.seekg(0);
    file.read(reinterpret_cast<char*>(all.data()), static_cast<std::streamsize>(bytes));
    if (!file) fail("cannot read all of " + path);
    return all;
}

double seconds_since(std::chrono::steady_clock::time_point start) {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

// Runs `trace(first, last)` over all rays once, on all threads.
void pass(size_t count, unsigned threads, const std::function<void(size_t, size_t)>& trace) {
    std::atomic<size_t> next{0};
    auto work = [&] {
        // As Embree asks for: denormals are zero.
        _MM_SET_FLUSH_ZERO_MODE(_MM_FLUSH_ZERO_ON);
        _MM_SET_DENORMALS_ZERO_MODE(_MM_DENORMALS_ZERO_ON);
        for (size_t first; (first = next.fetch_add(CHUNK)) < count;) trace(first, std::min(first + CHUNK, count));
    };
    std::vector<std::thread> all;
    for (unsigned i = 1; i < threads; ++i) all.emplace_back(work);
    work();
    for (auto& thread : all) thread.join();
}

// Millions of rays a second: the median of as many passes as take `seconds`, three at least.
double rate(size_t count, unsigned threads, double seconds, const std::function<void(size_t, size_t)>& trace) {
    pass(count, threads, trace);
    std::vector<double> times;
    for (const auto start = std::chrono::steady_clock::now(); times.size() < 3 || seconds_since(start) < seconds;) {
        const auto begun = std::chrono::steady_clock::now();
        pass(count, threads, trace);
        times.push_back(seconds_since(begun));
    }
    std::nth_element(times.begin(), times.begin() + times.size() / 2, times.end());
    return count / times[times.size() / 2] / 1e6;
}

struct Traced {
    const std::vector<Ray>& rays;
    std::vector<Hit>& found;
    RTCScene scene;
    bool any;

    void one(size_t first, size_t last) const {
        RTCIntersectContext context;
        rtcInitIntersectContext(&context);
        for (size_t i = first; i < last; ++i) {
            const Ray& r = rays[i];
            RTCRayHit rh;
            rh.ray = {r.origin[0], r.origin[1], r.origin[2], r.t_min, r.direction[0], r.direction[1], r.direction[2], 0.0f,
                      r.t_max, ~0u, 0, 0};
            rh.hit.geomID = rh.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
            if (any) {
                rtcOccluded1(scene, &context, &rh.ray);
                found[i] = {rh.ray.tfar, rh.ray.tfar < 0.0f ? 0u : NOTHING};
            } else {
                rtcIntersect1(scene, &context, &rh);
                found[i] = {rh.ray.tfar, rh.hit.geomID == RTC_INVALID_GEOMETRY_ID ? NOTHING : rh.hit.primID};
            }
        }
    }

    void sixteen(size_t first, size_t last) const {
        RTCIntersectContext context;
        rtcInitIntersectContext(&context);
        context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
        for (size_t i = first; i < last; i += 16) {
            RTCRayHit16 rh;
            alignas(64) int valid[16];
            const size_t lanes = std::min<size_t>(16, last - i);
            for (size_t k = 0; k < 16; ++k) {
                const Ray& r = rays[i + std::min(k, lanes - 1)];
                valid[k] = k < lanes ? -1 : 0;
                rh.ray.org_x[k] = r.origin[0], rh.ray.org_y[k] = r.origin[1], rh.ray.org_z[k] = r.origin[2];
                rh.ray.dir_x[k] = r.direction[0], rh.ray.dir_y[k] = r.direction[1], rh.ray.dir_z[k] = r.direction[2];
                rh.ray.tnear[k] = r.t_min, rh.ray.tfar[k] = r.t_max, rh.ray.time[k] = 0.0f;
                rh.ray.mask[k] = ~0u, rh.ray.id[k] = 0, rh.ray.flags[k] = 0;
                rh.hit.geomID[k] = rh.hit.instID[0][k] = RTC_INVALID_GEOMETRY_ID;
            }
            if (any) {
                rtcOccluded16(valid, scene, &context, &rh.ray);
            } else {
                rtcIntersect16(valid, scene, &context, &rh);
            }
            for (size_t k = 0; k < lanes; ++k) {
                const bool met = any ? rh.ray.tfar[k] < 0.0f : rh.hit.geomID[k] != RTC_INVALID_GEOMETRY_ID;
                found[i + k] = {rh.ray.tfar[k], met ? (any ? 0u : rh.hit.primID[k]) : NOTHING};
            }
        }
    }

    // The share of rays that met what we met: nothing, anything, or something at the same distance. Two triangles that share an edge
    // may each be right, so their numbers are not compared. Nor are rays that go on behind glass from where they met it: whether they meet
    // it once more hangs on the last bit.
    double agreeing(const std::vector<Hit>& ours) const {
        size_t same = 0, compared = 0;
        for (size_t i = 0; i < rays.size(); ++i) {
            if (rays[i].t_min > 0.0f) continue;
            ++compared;
            const bool met = found[i].triangle != NOTHING, we_met = ours[i].triangle != NOTHING;
            same += met == we_met && (!met || any || std::fabs(found[i].t - ours[i].t) <= SAME * std::max(1.0f, ours[i].t));
        }
        return compared == 0 ? 1.0 : double(same) / double(compared);
    }
};

// A scene of one range of the triangles.
RTCScene built(RTCDevice device, const std::vector<float>& corners, size_t first, size_t count, RTCBuildQuality quality) {
    RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
    auto* vertices = static_cast<float*>(
        rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 3 * sizeof(float), 3 * count));
    auto* indices = static_cast<uint32_t*>(
        rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 3 * sizeof(uint32_t), count));
    if (!vertices || !indices) fail("Embree gives no buffers");
    std::memcpy(vertices, corners.data() + 9 * first, 9 * sizeof(float) * count);
    for (uint32_t i = 0; i < 3 * count; ++i) indices[i] = i;
    rtcSetGeometryBuildQuality(geometry, quality);
    rtcCommitGeometry(geometry);
    RTCScene scene = rtcNewScene(device);
    rtcSetSceneBuildQuality(scene, quality);
    rtcAttachGeometry(scene, geometry);
    rtcReleaseGeometry(geometry);
    rtcCommitScene(scene);
    return scene;
}

}  // namespace

int main(int argc, char** argv) {
    if (argc < 6) fail("usage: trace FOLDER THREADS SECONDS medium|high KIND:closest|any:FIRST:COUNT…");
    const std::string folder = argv[1];
    const auto threads = static_cast<unsigned>(std::max(1, std::atoi(argv[2])));
    const double seconds = std::atof(argv[3]);
    const bool high = std::string(argv[4]) == "high";

    RTCDevice device = rtcNewDevice(("threads=" + std::to_string(threads)).c_str());
    if (!device) fail("Embree gives no device");
    rtcSetDeviceErrorFunction(device, [](void*, RTCError, const char* text) { fail(std::string("Embree: ") + text); }, nullptr);
    const auto corners = read<float>(folder + "/triangles.f32");

    std::printf("{\"quality\": \"%s\", \"threads\": %u, \"kinds\": {", argv[4], threads);
    for (int at = 5; at < argc; ++at) {
        char kind[32], ends[16];
        size_t first, count;
        if (std::sscanf(argv[at], "%31[^:]:%15[^:]:%zu:%zu", kind, ends, &first, &count) != 4) fail("what is " + std::string(argv[at]));
        if ((first + count) * 9 > corners.size()) fail("there are fewer triangles than that");
        const auto rays = read<Ray>(folder + "/" + kind + ".rays");
        const auto ours = read<Hit>(folder + "/" + kind + ".hits");
        if (rays.size() != ours.size()) fail(std::string(kind) + " has not as many hits as rays");

        const auto begun = std::chrono::steady_clock::now();
        RTCScene scene = built(device, corners, first, count, high ? RTC_BUILD_QUALITY_HIGH : RTC_BUILD_QUALITY_MEDIUM);
        const double build_s = seconds_since(begun);
        std::vector<Hit> found(rays.size());
        Traced traced{rays, found, scene, std::string(ends) == "any"};
        const double one = rate(rays.size(), threads, seconds, [&](size_t a, size_t b) { traced.one(a, b); });
        const double agreeing = traced.agreeing(ours);
        const double sixteen = rate(rays.size(), threads, seconds, [&](size_t a, size_t b) { traced.sixteen(a, b); });
        std::printf("%s\"%s\": {\"rays\": %zu, \"build_s\": %.3f, \"single_mray_s\": %.3f, \"packet_mray_s\": %.3f, "
                    "\"agreeing\": %.7f, \"agreeing_packets\": %.7f}",
                    at > 5 ? ", " : "", kind, rays.size(), build_s, one, sixteen, agreeing, traced.agreeing(ours));
        rtcReleaseScene(scene);
    }
    std::printf("}}\n");
    rtcReleaseDevice(device);
}
