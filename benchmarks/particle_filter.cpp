// A particle filter in C++ on a scan's map, with which speed.py compares ours: what compiled code could take.
//
// Sampling importance resampling with the densities of core/likelihood/on_map.py, at all components of the nearest
// node. It has none of what makes a sweep robust: no level, no gain along trajectories, no other explanations. So all
// but the residual of a component is known before.
//
// From standard input, in this order (d axes, F phalanges, C channels, M nodes, n components):
//   int64    particles, steps, d, F, n; nodes along each axis (d); first channel of each phalanx (F + 1);
//            first component of each node, and their end (M + 1)
//   float64  first node, distance of nodes, lower and upper bound, motion noise per root metre, each (d);
//            degrees of freedom, variance of the gain; displacement (d) and exponent of each step; strains (C)
//   float32  of the components strain (n, C), variances and log-prior (F + 1, n)
// An exponent of zero begins a sweep, with a uniform belief. Prints the median time of an update, us, and the last
// estimate (d).

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <random>
#include <vector>

template <class T>
static std::vector<T> read(size_t count)
{
    std::vector<T> values(count);
    if (std::fread(values.data(), sizeof(T), count, stdin) != count) std::exit(1);
    return values;
}

static constexpr float IMPOSSIBLE = -1e30f; // finite, for -ffast-math

int main()
{
    const auto sizes = read<int64_t>(5);
    const size_t particles = sizes[0], steps = sizes[1], axes = sizes[2], phalanges = sizes[3], components = sizes[4];
    const auto shape = read<int64_t>(axes), bounds = read<int64_t>(phalanges + 1);
    const size_t channels = bounds.back();
    size_t nodes = 1;
    for (const auto count : shape) nodes *= count;
    const auto starts = read<int64_t>(nodes + 1);
    const auto origin = read<double>(axes), step = read<double>(axes), lower = read<double>(axes);
    const auto upper = read<double>(axes), noise = read<double>(axes), model = read<double>(2);
    const float degrees = model[0], gain = model[1];
    const auto motions = read<double>(steps * (axes + 1)), strains = read<double>(steps * channels);
    const auto signals = read<float>(components * channels), spread = read<float>((phalanges + 1) * components);
    std::vector<float> constants(phalanges * components), along(constants.size());
    for (size_t f = 0; f < phalanges; f++) {
        for (size_t k = 0; k < components; k++) {
            const float *signal = &signals[k * channels];
            float energy = 0.0f;
            for (int64_t c = bounds[f]; c < bounds[f + 1]; c++) energy += signal[c] * signal[c];
            const float visit = spread[f * components + k], total = visit + gain * energy;
            along[k * phalanges + f] = gain / total;
            constants[k * phalanges + f] = spread[phalanges * components + k] -
                                           0.5f * ((bounds[f + 1] - bounds[f] - 1) * std::log(visit) + std::log(total));
        }
    }

    std::mt19937_64 random(0);
    std::normal_distribution<double> normal;
    std::uniform_real_distribution<double> uniform;
    std::vector<double> states(particles * axes), moved(states.size()), weights(particles, 1.0 / particles);
    std::vector<float> strain(channels), densities(components);
    std::vector<double> joint(particles), taken, estimate(axes);
    for (size_t t = 0; t < steps; t++) {
        const auto began = std::chrono::steady_clock::now();
        const double *motion = &motions[t * (axes + 1)], exponent = motion[axes];
        std::copy_n(&strains[t * channels], channels, strain.begin());
        if (exponent == 0.0) {
            for (size_t n = 0; n < states.size(); n++)
                states[n] = lower[n % axes] + uniform(random) * (upper[n % axes] - lower[n % axes]);
            std::fill(weights.begin(), weights.end(), 1.0 / particles);
        }
        double travel = 0.0, largest = IMPOSSIBLE, total = 0.0, squares = 0.0;
        for (size_t a = 0; a < axes; a++) travel += motion[a] * motion[a];
        const double root = std::sqrt(std::sqrt(travel));
        for (size_t n = 0; n < particles; n++) {
            size_t node = 0;
            bool inside = true;
            for (size_t a = 0; a < axes; a++) {
                double &at = states[n * axes + a];
                at += motion[a] + noise[a] * root * normal(random);
                inside = inside && at >= lower[a] && at <= upper[a];
                const double index = std::nearbyint((at - origin[a]) / step[a]);
                node = node * shape[a] + size_t(std::clamp(index, 0.0, double(shape[a] - 1)));
            }
            double likelihood = 0.0;
            for (size_t f = 0; f < phalanges; f++) {
                const float width = bounds[f + 1] - bounds[f];
                float peak = IMPOSSIBLE, sum = 0.0f;
                const int64_t first = starts[node], last = starts[node + 1];
                for (int64_t k = first; k < last; k++) {
                    const float *signal = &signals[k * channels];
                    float product = 0.0f, squared = 0.0f;
                    for (int64_t c = bounds[f]; c < bounds[f + 1]; c++) {
                        const float left = strain[c] - signal[c];
                        product += left * signal[c];
                        squared += left * left;
                    }
                    const float across = std::max(squared - along[k * phalanges + f] * product * product, 0.0f);
                    const float length = across / spread[f * components + k];
                    densities[k - first] = constants[k * phalanges + f] -
                                           0.5f * (degrees + width) * std::log(1.0f + length / degrees);
                    peak = std::max(peak, densities[k - first]);
                }
                for (int64_t k = 0; k < last - first; k++) sum += std::exp(densities[k] - peak);
                likelihood += peak + std::log(sum);
            }
            joint[n] = inside ? exponent * likelihood : IMPOSSIBLE;
            largest = std::max(largest, joint[n]);
        }
        for (size_t n = 0; n < particles; n++) total += weights[n] *= std::exp(joint[n] - largest);
        std::fill(estimate.begin(), estimate.end(), 0.0);
        for (size_t n = 0; n < particles; n++) {
            weights[n] /= total;
            squares += weights[n] * weights[n];
            for (size_t a = 0; a < axes; a++) estimate[a] += weights[n] * states[n * axes + a];
        }
        if (squares * particles > 2.0) { // systematic resampling
            double point = uniform(random) / particles, cumulative = 0.0;
            for (size_t n = 0, m = 0; m < particles; m++, point += 1.0 / particles) {
                while (n + 1 < particles && cumulative + weights[n] < point) cumulative += weights[n++];
                std::copy_n(&states[n * axes], axes, &moved[m * axes]);
            }
            states.swap(moved);
            std::fill(weights.begin(), weights.end(), 1.0 / particles);
        }
        taken.push_back(std::chrono::duration<double, std::micro>(std::chrono::steady_clock::now() - began).count());
    }
    std::nth_element(taken.begin(), taken.begin() + taken.size() / 2, taken.end());
    std::printf("%.3f", taken[taken.size() / 2]);
    for (const double along : estimate) std::printf(" %.6f", along);
}
