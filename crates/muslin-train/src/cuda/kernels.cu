// A step of a training on a device: network, shapes, skinning, laws, and the way back to what is learnt.
//
// The formulas are those of `work.rs`, `laws.rs`, `body.rs`, `factor.rs` and `update.rs`. Arrays that have an entry a pose have
// the sixteen poses of a pack innermost. Sums are taken in a fixed order, by gathering: the same bits in every run on one
// device. Written in what C and CUDA share, so that `emulated.c` can run it on any machine. `BLOCK`, the threads of a block
// where threads work together, `SOLVERS`, those of one that solves, and `ABREAST`, those of them that share a vertex, come from
// outside: a multiple of sixteen, and powers of two.

#ifdef __CUDACC__
extern "C" {
#endif

#define LANES 16
// Entries of a block that a pose has.
#define ROWS (BLOCK / LANES)
#define NONE 0xffffffffu
// Terms of the cost: stretch; then bending, weight, contact, pins, and how many vertices are behind their wall.
#define TERMS 6

// A layer of the network; `w` by output, then input, and biases after it. `out` is before it is bent, `bent` after.
__global__ void dense(const float *w, unsigned at, const float *in, float *out, float *bent, unsigned inputs,
                      unsigned outputs)
{
    const unsigned i = blockIdx.x * blockDim.x + threadIdx.x, o = i / LANES, lane = i % LANES;
    if (o >= outputs)
        return;
    w += at;
    float sum = w[outputs * inputs + o];
    for (unsigned k = 0; k < inputs; k++)
        sum += w[o * inputs + k] * in[k * LANES + lane];
    out[i] = sum;
    bent[i] = sum / (1.0f + expf(-sum));
}

// The slope in a layer's parameters, `share` of it added to what is there, or put there where `first`.
__global__ void dense_slope(float *slope, unsigned at, const float *in, const float *d, unsigned inputs, unsigned outputs,
                            float share, unsigned first)
{
    const unsigned i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i >= outputs * (inputs + 1))
        return;
    float sum = 0.0f;
    if (i < outputs * inputs) {
        const float *x = in + i % inputs * LANES, *y = d + i / inputs * LANES;
        for (unsigned lane = 0; lane < LANES; lane++)
            sum += x[lane] * y[lane];
    } else {
        for (unsigned lane = 0; lane < LANES; lane++)
            sum += d[(i - outputs * inputs) * LANES + lane];
    }
    slope[at + i] = (first ? 0.0f : slope[at + i]) + share * sum;
}

// From the slope in a layer's outputs to that in what was bent to be its inputs.
__global__ void dense_back(const float *w, unsigned at, const float *d, const float *unbent, float *before, unsigned inputs,
                           unsigned outputs)
{
    const unsigned i = blockIdx.x * blockDim.x + threadIdx.x, k = i / LANES, lane = i % LANES;
    if (k >= inputs)
        return;
    w += at;
    float sum = 0.0f;
    for (unsigned o = 0; o < outputs; o++)
        sum += w[o * inputs + k] * d[o * LANES + lane];
    const float x = unbent[i], s = 1.0f / (1.0f + expf(-x));
    before[i] = sum * s * (1.0f + x * (1.0f - s));
}

// What bones do to what follows vertex `v`: three columns, then the place.
__device__ void blend(const unsigned *starts, const unsigned *bones, const float *weights, const float *posed, unsigned v,
                      unsigned lane, float *a)
{
    for (int j = 0; j < 12; j++)
        a[j] = 0.0f;
    for (unsigned e = starts[v]; e < starts[v + 1]; e++) {
        const float *b = posed + 12 * LANES * bones[e] + lane, w = weights[e];
        for (int j = 0; j < 12; j++)
            a[j] += b[j * LANES] * w;
    }
}

__device__ void carry(const float *a, const float *p, float *out)
{
    for (int j = 0; j < 3; j++)
        out[j] = a[j] * p[0] + a[3 + j] * p[1] + a[6 + j] * p[2] + a[9 + j];
}

// A direction in the world as one in the rest frame.
__device__ void bring_back(const float *a, const float *g, float *out)
{
    for (int j = 0; j < 3; j++)
        out[j] = a[3 * j] * g[0] + a[3 * j + 1] * g[1] + a[3 * j + 2] * g[2];
}

__device__ float dot(const float *a, const float *b)
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

// Of vertex `v` its three rows of shapes times the codes.
__device__ void mix(const float *shapes, const float *codes, unsigned k, unsigned v, unsigned lane, float *p)
{
    const float *m = shapes + (size_t)3 * v * k;
    p[0] = p[1] = p[2] = 0.0f;
    for (unsigned c = 0; c < k; c++) {
        const float z = codes[c * LANES + lane];
        p[0] += m[c] * z;
        p[1] += m[k + c] * z;
        p[2] += m[2 * k + c] * z;
    }
}

// Over the rows of a block, for one pose.
__device__ float sum_rows(const float *of, unsigned lane)
{
    float sum = 0.0f;
    for (int r = 0; r < ROWS; r++)
        sum += of[r * LANES + lane];
    return sum;
}

// Over a block.
__device__ float most_of(const float *of)
{
    float most = of[0];
    for (int i = 1; i < BLOCK; i++)
        most = fmaxf(most, of[i]);
    return most;
}

// From codes to where vertices are.
__global__ void place(const float *modes, const float *codes, unsigned k, const float *laid, const unsigned *starts,
                      const unsigned *bones, const float *weights, const float *posed, float *x, unsigned n)
{
    const unsigned i = blockIdx.x * blockDim.x + threadIdx.x, v = i / LANES, lane = i % LANES;
    if (v >= n)
        return;
    float p[3], a[12], out[3];
    mix(modes, codes, k, v, lane, p);
    for (int j = 0; j < 3; j++)
        p[j] += laid[3 * v + j];
    blend(starts, bones, weights, posed, v, lane, a);
    carry(a, p, out);
    for (int j = 0; j < 3; j++)
        x[(3 * v + j) * LANES + lane] = out[j];
}

typedef struct {
    float off[3], weights[3], square;
} Near;

__device__ Near at_weights(const float t[3][3], float u, float v, float w)
{
    Near out;
    for (int j = 0; j < 3; j++)
        out.off[j] = t[0][j] * u + t[1][j] * v + t[2][j] * w;
    out.weights[0] = u;
    out.weights[1] = v;
    out.weights[2] = w;
    out.square = dot(out.off, out.off);
    return out;
}

// The point of face `f` nearest to `p`, seen from there.
__device__ Near nearest(const unsigned *faces, const float *skin, unsigned f, const float *p)
{
    float t[3][3], ab[3], ac[3];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            t[i][j] = skin[6 * faces[3 * f + i] + j] - p[j];
    for (int j = 0; j < 3; j++) {
        ab[j] = t[1][j] - t[0][j];
        ac[j] = t[2][j] - t[0][j];
    }
    const float d1 = -dot(ab, t[0]), d2 = -dot(ac, t[0]);
    if (d1 <= 0.0f && d2 <= 0.0f)
        return at_weights(t, 1.0f, 0.0f, 0.0f);
    const float d3 = -dot(ab, t[1]), d4 = -dot(ac, t[1]);
    if (d3 >= 0.0f && d4 <= d3)
        return at_weights(t, 0.0f, 1.0f, 0.0f);
    const float vc = d1 * d4 - d3 * d2;
    if (vc <= 0.0f && d1 >= 0.0f && d3 <= 0.0f) {
        const float v = d1 / (d1 - d3);
        return at_weights(t, 1.0f - v, v, 0.0f);
    }
    const float d5 = -dot(ab, t[2]), d6 = -dot(ac, t[2]);
    if (d6 >= 0.0f && d5 <= d6)
        return at_weights(t, 0.0f, 0.0f, 1.0f);
    const float vb = d5 * d2 - d1 * d6;
    if (vb <= 0.0f && d2 >= 0.0f && d6 <= 0.0f) {
        const float w = d2 / (d2 - d6);
        return at_weights(t, 1.0f - w, 0.0f, w);
    }
    const float va = d3 * d6 - d5 * d4;
    if (va <= 0.0f && d4 >= d3 && d5 >= d6) {
        const float w = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        return at_weights(t, 0.0f, 1.0f - w, w);
    }
    const float s = 1.0f / (va + vb + vc);
    return at_weights(t, 1.0f - vb * s - vc * s, vb * s, vc * s);
}

// Steps from face to face, and how far behind the skin a way is lost, and no direction nearer than this [m].
#define HOPS 12
#define LOST 0.02f
#define TOUCHING 5e-5f

// The wall of every vertex, followed over the skin from face to face: `skin` has place and normal of each of its `n_skin`
// vertices, pose after pose.
__global__ void walls(const unsigned *faces, const unsigned *starts, const unsigned *around, const unsigned *rim,
                      const float *skin, unsigned n_skin, const float *x, unsigned *at, float *planes, unsigned n)
{
    const unsigned i = blockIdx.x * blockDim.x + threadIdx.x, v = i / LANES, lane = i % LANES;
    if (v >= n)
        return;
    float plane[4] = {0.0f, 0.0f, 0.0f, -1.0f};
    unsigned face = at[i];
    if (face != NONE) {
        skin += (size_t)6 * n_skin * lane;
        const float p[3] = {x[3 * v * LANES + lane], x[(3 * v + 1) * LANES + lane], x[(3 * v + 2) * LANES + lane]};
        Near hit = nearest(faces, skin, face, p);
        for (int hop = 0; hop < HOPS; hop++) {
            const float *w = hit.weights;
            if (w[0] > 0.0f && w[1] > 0.0f && w[2] > 0.0f)
                break;
            // The last of the largest.
            const int corner = w[2] >= w[0] && w[2] >= w[1] ? 2 : w[1] >= w[0] ? 1 : 0;
            const unsigned pivot = faces[3 * face + corner], before = face;
            for (unsigned e = starts[pivot]; e < starts[pivot + 1]; e++) {
                const Near next = nearest(faces, skin, around[e], p);
                if (next.square < hit.square) {
                    hit = next;
                    face = around[e];
                }
            }
            if (face == before)
                break;
        }
        float smooth[3], away[3];
        for (int j = 0; j < 3; j++) {
            smooth[j] = 0.0f;
            for (int c = 0; c < 3; c++)
                smooth[j] += skin[6 * faces[3 * face + c] + 3 + j] * hit.weights[c];
            away[j] = -hit.off[j];
        }
        const float out = dot(away, smooth);
        if (!(out < 0.0f && hit.square > LOST * LOST) && !rim[face]) {
            float by, *along = smooth;
            if (hit.square > TOUCHING * TOUCHING) {
                along = away;
                by = (out < 0.0f ? -1.0f : 1.0f) / sqrtf(hit.square);
            } else {
                const float long_ = sqrtf(dot(smooth, smooth));
                by = long_ > 0.0f ? 1.0f / long_ : 0.0f;
            }
            plane[3] = 0.0f;
            for (int j = 0; j < 3; j++) {
                plane[j] = along[j] * by;
                plane[3] += plane[j] * (p[j] + hit.off[j]);
            }
        }
        at[i] = face;
    }
    for (int j = 0; j < 4; j++)
        planes[(4 * v + j) * LANES + lane] = plane[j];
}

// Stretch and shear: of a face's forces those at its second and third corner, and what they cost, block by block. Of a face
// `patches` has slopes (4), area, stiffness (3), and what is left of it in compression.
__global__ void patches(const unsigned *faces, const float *patches, float firmness, const float *x, float *forces,
                        float *costs, unsigned n)
{
    __shared__ float cost[BLOCK];
    const unsigned i = blockIdx.x * blockDim.x + threadIdx.x, face = i / LANES, lane = i % LANES;
    cost[threadIdx.x] = 0.0f;
    if (face < n) {
        const float *p = patches + 9 * face;
        float f[2][3], stress[2][3];
        for (int j = 0; j < 3; j++) {
            const float x0 = x[(3 * faces[3 * face] + j) * LANES + lane];
            const float a = x[(3 * faces[3 * face + 1] + j) * LANES + lane] - x0;
            const float b = x[(3 * faces[3 * face + 2] + j) * LANES + lane] - x0;
            f[0][j] = a * p[0] + b * p[2];
            f[1][j] = a * p[1] + b * p[3];
        }
        const float shear = dot(f[0], f[1]), area = firmness * p[4];
        float density = shear * shear * p[7];
        for (int k = 0; k < 2; k++) {
            // A yarn of length zero has no direction; nothing is divided by zero.
            const float long_ = sqrtf(fmaxf(dot(f[k], f[k]), 1e-24f)), strain = long_ - 1.0f;
            const float stiff = long_ < 1.0f ? p[5 + k] * p[8] : p[5 + k];
            density += stiff * strain * strain;
            for (int j = 0; j < 3; j++)
                stress[k][j] = f[1 - k][j] * (shear * p[7]) + f[k][j] * (stiff * strain / long_);
        }
        for (int c = 0; c < 2; c++)
            for (int j = 0; j < 3; j++)
                forces[((2 * face + c) * 3 + j) * LANES + lane] = (stress[0][j] * p[2 * c] + stress[1][j] * p[2 * c + 1]) * area;
        cost[threadIdx.x] = density * (0.5f * area);
    }
    __syncthreads();
    if (threadIdx.x < LANES)
        costs[blockIdx.x * LANES + threadIdx.x] = sum_rows(cost, threadIdx.x);
}

// How a wall pushes: `muslin_energy::contact::Barrier`.
typedef struct {
    float radius, width, stiffness;
} Wall;

// At a vertex: adds energy, force and, as seen from the rest frame, stiffness; gives the gap.
__device__ float push(Wall wall, const float *planes, const float *here, const float *a, unsigned lane, float *cost,
                      float *force, float *stiff)
{
    const float normal[3] = {planes[lane], planes[LANES + lane], planes[2 * LANES + lane]};
    const float gap = dot(normal, here) - planes[3 * LANES + lane], w = wall.width, k = wall.stiffness;
    const float s = fmaxf(wall.radius - gap, 0.0f), soft = fminf(s, w), over = s - soft;
    *cost += soft * soft * soft * (k / (6.0f * w)) + over * (over + w) * (0.5f * k);
    const float slope = soft * soft * (-0.5f * k / w) - over * k, curved = soft * (k / w);
    float m[3];
    bring_back(a, normal, m);
    for (int j = 0; j < 3; j++) {
        force[j] += normal[j] * slope;
        stiff[j] += m[j] * m[j] * curved;
    }
    stiff[3] += m[0] * m[1] * curved;
    stiff[4] += m[0] * m[2] * curved;
    stiff[5] += m[1] * m[2] * curved;
    return gap;
}

// What else vertices cost, block by block, and all that pulls them, in the rest frame; how stiffly walls hold each, `share` of
// it added to what is there, or put there where `first`; and of a block the first vertex whose forces are not finite.
// `shared` are a vertex's faces, three times their number plus its corner. `folds` are planes, and `fold_of` which is a
// vertex's.
__global__ void gather(const unsigned *shared_starts, const unsigned *shared, const float *forces,
                       const unsigned *bend_starts, const unsigned *bent, const float *bend, const float *mass,
                       const float *laid, const unsigned *pinned, const unsigned *starts, const unsigned *bones,
                       const float *weights, const float *posed, const float *planes, const unsigned *fold_of,
                       const float *folds, float radius, float width, float stiffness, float pin, float gravity,
                       const float *x, float *g, float *costs, float *held, unsigned *broken, float share, unsigned first,
                       unsigned n)
{
    __shared__ float cost[TERMS - 1][BLOCK], stiff[6][BLOCK];
    __shared__ unsigned bad[BLOCK];
    const unsigned t = threadIdx.x, v = blockIdx.x * ROWS + t / LANES, lane = t % LANES;
    const Wall wall = {radius, width, stiffness};
    float own[TERMS - 1] = {0.0f, 0.0f, 0.0f, 0.0f, 0.0f}, k[6] = {0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f};
    bad[t] = NONE;
    if (v < n) {
        float here[3], force[3] = {0.0f, 0.0f, 0.0f}, a[12], back[3];
        for (int j = 0; j < 3; j++)
            here[j] = x[(3 * v + j) * LANES + lane];
        for (unsigned e = shared_starts[v]; e < shared_starts[v + 1]; e++) {
            const float *f = forces + (size_t)(shared[e] / 3) * 6 * LANES + lane;
            const unsigned corner = shared[e] % 3;
            for (int j = 0; j < 3; j++)
                force[j] += corner == 0 ? -(f[j * LANES] + f[(3 + j) * LANES]) : f[(3 * (corner - 1) + j) * LANES];
        }
        float folded = 0.0f;
        for (unsigned e = bend_starts[v]; e < bend_starts[v + 1]; e++) {
            const float q = bend[e];
            float d[3];
            for (int j = 0; j < 3; j++) {
                d[j] = x[(3 * bent[e] + j) * LANES + lane] - here[j];
                force[j] += d[j] * q;
            }
            folded += dot(d, d) * q;
        }
        const float weight = mass[v] * gravity;
        own[0] = -0.25f * folded;
        own[1] = here[1] * weight;
        force[1] += weight;
        blend(starts, bones, weights, posed, v, lane, a);
        const float gap = push(wall, planes + (size_t)4 * v * LANES, here, a, lane, &own[2], force, k);
        own[4] = gap < 0.0f ? 1.0f : 0.0f;
        if (fold_of[v] != NONE)
            push(wall, folds + (size_t)4 * fold_of[v] * LANES, here, a, lane, &own[2], force, k);
        if (pinned[v]) {
            float at[3];
            carry(a, laid + 3 * v, at);
            for (int j = 0; j < 3; j++) {
                at[j] = here[j] - at[j];
                force[j] += at[j] * pin;
            }
            own[3] = dot(at, at) * (0.5f * pin);
        }
        bring_back(a, force, back);
        for (int j = 0; j < 3; j++) {
            g[(3 * v + j) * LANES + lane] = back[j];
            // Neither more nor less than what is largest, nor equal to itself.
            if (!(fabsf(back[j]) <= 3.4e38f))
                bad[t] = v;
        }
    }
    for (int j = 0; j < TERMS - 1; j++)
        cost[j][t] = own[j];
    for (int j = 0; j < 6; j++)
        stiff[j][t] = k[j];
    __syncthreads();
    for (unsigned i = t; i < (TERMS - 1) * LANES; i += BLOCK)
        costs[(size_t)blockIdx.x * (TERMS - 1) * LANES + i] = sum_rows(cost[i / LANES], i % LANES);
    for (unsigned i = t; i < 6 * ROWS; i += BLOCK) {
        const unsigned row = i / 6, j = i % 6, to = blockIdx.x * ROWS + row;
        if (to >= n)
            continue;
        float sum = 0.0f;
        for (int q = 0; q < LANES; q++)
            sum += stiff[j][row * LANES + q];
        held[6 * to + j] = (first ? 0.0f : held[6 * to + j]) + share * (sum / LANES);
    }
    if (t == 0) {
        unsigned least = NONE;
        for (int i = 0; i < BLOCK; i++)
            least = bad[i] < least ? bad[i] : least;
        broken[blockIdx.x] = least;
    }
}

// All that a pack costs, pose by pose; how much each counts; and the first vertex whose forces are not finite, by block.
__global__ void count(const float *stretch, unsigned n_stretch, const float *costs, const unsigned *broken, unsigned n_costs,
                      float fair, float fairness, float *told)
{
    __shared__ float parts[BLOCK];
    const unsigned t = threadIdx.x, row = t / LANES, lane = t % LANES;
    for (int term = 0; term < TERMS; term++) {
        float sum = 0.0f;
        if (term == 0)
            for (unsigned b = row; b < n_stretch; b += ROWS)
                sum += stretch[b * LANES + lane];
        else
            for (unsigned b = row; b < n_costs; b += ROWS)
                sum += costs[((size_t)b * (TERMS - 1) + term - 1) * LANES + lane];
        parts[t] = sum;
        __syncthreads();
        if (t < LANES)
            told[term * LANES + t] = sum_rows(parts, t);
        __syncthreads();
    }
    if (t < LANES) {
        const float hard = told[t] + told[3 * LANES + t];
        told[TERMS * LANES + t] = powf(fminf(fair / fmaxf(hard, 1e-9f), 1.0f), fairness);
    }
    // A number is told as a float, and nothing as minus one.
    if (t == 0) {
        unsigned least = NONE;
        for (unsigned b = 0; b < n_costs; b++)
            least = broken[b] < least ? broken[b] : least;
        told[(TERMS + 1) * LANES] = least == NONE ? -1.0f : (float)least;
    }
}

// The codes by how much each pose counts.
__global__ void weigh(const float *codes, const float *told, float *weighed, unsigned k)
{
    const unsigned i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i < k * LANES)
        weighed[i] = codes[i] * (told[TERMS * LANES + i % LANES] / LANES);
}

// `a bᵀ` over the poses, `share` of it added to what is there, or put there where `first`: the codes' moments, and the slope
// in the shapes.
__global__ void outer(const float *a, const float *b, float *out, unsigned rows, unsigned k, float share, unsigned first)
{
    const unsigned i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i >= rows * k)
        return;
    const float *x = a + (size_t)(i / k) * LANES, *y = b + i % k * LANES;
    float sum = 0.0f;
    for (int lane = 0; lane < LANES; lane++)
        sum += x[lane] * y[lane];
    out[i] = (first ? 0.0f : out[i]) + share * sum;
}

// The slope in the codes: a block has a code and a part of the rows.
__global__ void code_parts(const float *modes, const float *g, float *parts, unsigned rows, unsigned k)
{
    __shared__ float sums[BLOCK];
    const unsigned t = threadIdx.x, c = blockIdx.x, lane = t % LANES, step = ROWS * gridDim.y;
    float sum = 0.0f;
    for (unsigned r = blockIdx.y * ROWS + t / LANES; r < rows; r += step)
        sum += modes[(size_t)r * k + c] * g[(size_t)r * LANES + lane];
    sums[t] = sum;
    __syncthreads();
    if (t < LANES)
        parts[(blockIdx.y * gridDim.x + c) * LANES + t] = sum_rows(sums, t);
}

__global__ void code_slope(const float *parts, unsigned n_parts, const float *told, float *slope, unsigned k)
{
    const unsigned i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i >= k * LANES)
        return;
    float sum = 0.0f;
    for (unsigned p = 0; p < n_parts; p++)
        sum += parts[p * k * LANES + i];
    slope[i] = sum * (told[TERMS * LANES + i % LANES] / LANES);
}

// Adam, with both corrections in step size and floor.
__global__ void adam(float *params, float *mean, float *square, const float *slope, float rate, float floor_, float a, float b,
                     unsigned n)
{
    const unsigned i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i >= n)
        return;
    const float g = slope[i];
    mean[i] = a * mean[i] + (1.0f - a) * g;
    square[i] = b * square[i] + (1.0f - b) * g * g;
    params[i] -= rate * mean[i] / (sqrtf(square[i]) + floor_);
}

// The running mean of the slope in the shapes.
__global__ void remember(float *momentum, const float *slope, float keep, unsigned n)
{
    const unsigned i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i < n)
        momentum[i] = keep * momentum[i] + (1.0f - keep) * slope[i];
}

// One sweep over the factor: levels of vertices that wait for none of their own level. `blocks` are by rows, as seen by this
// sweep, and `diagonal` as well.
__device__ void sweep(const unsigned *levels, unsigned n_levels, const unsigned *members, const unsigned *starts,
                      const unsigned *others, const float *blocks, const float *diagonal, float *x, float (*part)[SOLVERS])
{
    const unsigned t = threadIdx.x, lane = t % ABREAST, own = t / ABREAST;
    for (unsigned level = 0; level < n_levels; level++) {
        for (unsigned from = levels[level]; from < levels[level + 1]; from += SOLVERS / ABREAST) {
            const unsigned at = from + own, is_there = at < levels[level + 1];
            const unsigned v = is_there ? members[at] : 0;
            float sum[3] = {0.0f, 0.0f, 0.0f};
            if (is_there)
                for (unsigned e = starts[v] + lane; e < starts[v + 1]; e += ABREAST) {
                    const float *m = blocks + (size_t)9 * e, *y = x + 3 * others[e];
                    for (int j = 0; j < 3; j++)
                        sum[j] += dot(m + 3 * j, y);
                }
            for (int j = 0; j < 3; j++)
                part[j][t] = sum[j];
            for (unsigned half = ABREAST / 2; half > 0; half /= 2) {
                __syncthreads();
                if (lane < half)
                    for (int j = 0; j < 3; j++)
                        part[j][t] += part[j][t + half];
            }
            if (is_there && lane == 0) {
                const float *d = diagonal + 9 * v;
                float y[3];
                for (int j = 0; j < 3; j++)
                    y[j] = x[3 * v + j] - part[j][t];
                for (int j = 0; j < 3; j++)
                    x[3 * v + j] = dot(d + 3 * j, y);
            }
            __syncthreads();
        }
    }
}

// Divides by the stiffness: a block has a column of the `k`, in the order of elimination.
__global__ void solve(const unsigned *order, const unsigned *down_levels, unsigned n_down, const unsigned *down,
                      const unsigned *down_starts, const unsigned *down_others, const float *down_blocks,
                      const float *down_diagonal, const unsigned *up_levels, unsigned n_up, const unsigned *up,
                      const unsigned *up_starts, const unsigned *up_others, const float *up_blocks, const float *up_diagonal,
                      const float *b, float *solved, unsigned k, unsigned n)
{
    __shared__ float part[3][SOLVERS];
    const unsigned c = blockIdx.x;
    float *x = solved + (size_t)3 * n * c;
    for (unsigned i = threadIdx.x; i < 3 * n; i += SOLVERS)
        x[i] = b[(size_t)(3 * order[i / 3] + i % 3) * k + c];
    __syncthreads();
    sweep(down_levels, n_down, down, down_starts, down_others, down_blocks, down_diagonal, x, part);
    sweep(up_levels, n_up, up, up_starts, up_others, up_blocks, up_diagonal, x, part);
}

// What is solved times the inverse of the codes' moments; `places` are vertices' in the order of elimination.
__global__ void lead(const float *solved, const unsigned *places, const float *inverse, float *moves, unsigned k, unsigned n)
{
    const unsigned i = blockIdx.x * blockDim.x + threadIdx.x, r = i / k, c = i % k;
    if (r >= 3 * n)
        return;
    const float *x = solved + 3 * places[r / 3] + r % 3;
    float sum = 0.0f;
    for (unsigned q = 0; q < k; q++)
        sum += x[(size_t)3 * n * q] * inverse[q * k + c];
    moves[i] = sum;
}

// How far moves take vertices in the poses of a pack: the square of the farthest of each block, from `first` on.
__global__ void farthest(const float *moves, const float *codes, float *far, unsigned first, unsigned k, unsigned n)
{
    __shared__ float most[BLOCK];
    const unsigned t = threadIdx.x, v = blockIdx.x * ROWS + t / LANES, lane = t % LANES;
    most[t] = 0.0f;
    if (v < n) {
        float p[3];
        mix(moves, codes, k, v, lane, p);
        most[t] = dot(p, p);
    }
    __syncthreads();
    if (t == 0)
        far[first + blockIdx.x] = most_of(most);
}

// The step size with which nothing moves farther than `limit`.
__global__ void shorten(const float *far, unsigned n, float rate, float limit, float *out)
{
    __shared__ float most[BLOCK];
    const unsigned t = threadIdx.x;
    most[t] = 0.0f;
    for (unsigned i = t; i < n; i += BLOCK)
        most[t] = fmaxf(most[t], far[i]);
    __syncthreads();
    if (t == 0)
        out[0] = rate * fminf(limit / fmaxf(rate * sqrtf(most_of(most)), 1e-12f), 1.0f);
}

__global__ void move(float *modes, const float *moves, const float *by, unsigned n)
{
    const unsigned i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i < n)
        modes[i] -= by[0] * moves[i];
}

#ifdef __CUDACC__
}
#endif
