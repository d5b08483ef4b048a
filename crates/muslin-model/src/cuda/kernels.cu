// A crowd's garments on a device: network, swings, shapes, skinning and normals.
//
// The formulas are those of `layers.rs`, `swing.rs`, `walls.rs`, `ties.rs` and `group.rs`, in the same order where order
// matters; shapes are single precision floats instead of steps. What depends on the model alone lies in two arrays, `f` and
// `u`, and `Layout` (its twin is in `tables.rs`) says where in them. A frame's number is its moment times the number
// of wearers, plus its wearer's.
//
// Written in what C and CUDA share, so that `emulated.c` can run it on any machine. `FRAMES`, how many frames a block of
// `drape` takes, and `BLOCK`, the most threads that a block has, come from outside. Frames go along a grid's first axis, which
// is the longest.

#ifdef __CUDACC__
// Threads that go in step; elsewhere one is alone.
#define WARP 32
#define SHARED(name) extern __shared__ __align__(16) float name[]
__device__ float warp_sum(float x)
{
    for (int by = WARP / 2; by > 0; by /= 2)
        x += __shfl_xor_sync(0xffffffffu, x, by);
    return x;
}
// Who of them says yes, a bit each; and the first of these.
#define WHICH(yes) __ballot_sync(0xffffffffu, yes)
#define FIRST(which) (__ffs(which) - 1)
#define TOGETHER() __syncwarp()
extern "C" {
#endif

// Swings at most.
#define MOST 64
// Rounds over walls, and over ties, in a step.
#define ROUNDS 3
// Frames whose normals a thread gives.
#define TURNED 4

typedef struct {
    // How many there are; `n_codes` are those of the pose, then the swings.
    unsigned n_verts, n_codes, n_posed, n_swings, n_bones, n_points, n_walls, n_ties;
    // How many numbers a wearer's state has.
    unsigned n_state;
    // In `f`: template with the constant shape [axis][vertex]; shapes [code][axis][vertex]; how much bones are followed.
    unsigned base, shapes, weights;
    // In `u`: where a vertex's bones start; the bones; where its fans start, where a fan's neighbours do, neighbours.
    unsigned starts, bones, fans, spans, around;
    // Points that stand for cloth. In `f`: masses; shapes [code][point][axis]; where they lie; how much they follow; swings
    // [point][axis][swing]; damping; and the inverse system of a step. In `u`: where their bones start; the bones.
    unsigned masses, still, lie, point_weights, means, damping, inverse, point_starts, point_bones;
    // Walls. In `f`: shapes [code][wall][axis] of the vertex before each; where it lies; how much it follows; the skin's
    // point and its tip [wall][2][axis]; how much these follow; swings towards it [wall][swing]; pushes; gains. In `u`:
    // where the vertex's bones start; those bones; the skin's, FOLLOWED each.
    unsigned wall_still, wall_lie, wall_weights, feet, feet_weights, ways, pushes, gains, wall_starts, wall_bones, feet_bones;
    // Ties: in `f` how long each may be; in `u` its two points.
    unsigned longest, pairs;
    // Seconds from frame to frame, and two thirds of that; what is added to how much a push brings two points together.
    float step, tau, faint;
} Layout;

// Bones that a point of the skin follows.
#define FOLLOWED 4
// How near to the skin cloth may swing, and how far it may wherever it lies [m].
#define NEAR 0.004f
#define LEAST 0.001f

// A layer of the network, frame by frame: `w` by input, then output, and biases after it. `bend` is 0 for none, 1 for the
// rectifier, 2 for the hyperbolic tangent, 3 for x σ(x), 4 for the self-normalising one.
__global__ void layer(const float *w, const float *in, float *out, unsigned inputs, unsigned outputs, unsigned stride,
                      unsigned frames, unsigned bend)
{
    const unsigned o = blockIdx.y * blockDim.x + threadIdx.x, first = blockIdx.x * 8;
    if (o >= outputs)
        return;
    const unsigned n = frames - first < 8 ? frames - first : 8;
    const float *x = in + (size_t)first * inputs;
    float sum[8];
    for (int k = 0; k < 8; k++)
        sum[k] = w[inputs * outputs + o];
    if (n == 8) {
        for (unsigned i = 0; i < inputs; i++) {
            const float a = w[i * outputs + o];
#pragma unroll
            for (int k = 0; k < 8; k++)
                sum[k] += a * x[k * inputs + i];
        }
    } else {
        for (unsigned i = 0; i < inputs; i++)
            for (unsigned k = 0; k < n; k++)
                sum[k] += w[i * outputs + o] * x[k * inputs + i];
    }
    for (unsigned k = 0; k < n; k++) {
        float y = sum[k];
        if (bend == 1)
            y = fmaxf(y, 0.0f);
        else if (bend == 2)
            y = tanhf(y);
        else if (bend == 3)
            y = y / (1.0f + expf(-y));
        else if (bend == 4)
            y = 1.050701f * (fmaxf(y, 0.0f) + 1.6732632f * expm1f(fminf(y, 0.0f)));
        out[(size_t)(first + k) * stride + o] = y;
    }
}

// Where bones carry a point, and how they turn what is around it: three columns, then the place.
__device__ void carry(const unsigned *bones, const float *weights, unsigned from, unsigned to, const float *frame,
                      const float *p, float *out)
{
    float m[12];
    for (int j = 0; j < 12; j++)
        m[j] = 0.0f;
    for (unsigned e = from; e < to; e++) {
        const float *a = frame + 12 * bones[e];
        for (int j = 0; j < 12; j++)
            m[j] += weights[e] * a[j];
    }
    for (int j = 0; j < 9; j++)
        out[j] = m[j];
    for (int j = 0; j < 3; j++)
        out[9 + j] = m[j] * p[0] + m[3 + j] * p[1] + m[6 + j] * p[2] + m[9 + j];
}

// Where point `i` of `n` is before it is carried.
__device__ void laid(const float *shapes, const float *at, const float *z, unsigned codes, unsigned n, unsigned i, float *p)
{
    for (int j = 0; j < 3; j++)
        p[j] = at[3 * i + j];
    for (unsigned c = 0; c < codes; c++)
        for (int j = 0; j < 3; j++)
            p[j] += z[c] * shapes[(size_t)c * 3 * n + 3 * i + j];
}

__device__ float dot(const float *a, const float *b, unsigned k)
{
    float sum = 0.0f;
    for (unsigned i = 0; i < k; i++)
        sum += a[i] * b[i];
    return sum;
}

// How far swings `q` take point `i` along each axis of its own frame.
__device__ void way_of(const float *means, const float *q, unsigned k, unsigned i, float *way)
{
    for (int j = 0; j < 3; j++)
        way[j] = dot(means + (size_t)(3 * i + j) * k, q, k);
}

// Walls: no code of `q` goes farther than there is room. Every thread sees the same `q`.
__device__ void hold_walls(const Layout *l, const float *f, const float *rooms, float *all, float *q, volatile int *flag)
{
    const unsigned k = l->n_swings;
    for (int round = 0; round < ROUNDS; round++) {
        if (threadIdx.x == 0)
            *flag = 0;
        __syncthreads();
        for (unsigned w = threadIdx.x; w < l->n_walls; w += blockDim.x) {
            all[w] = -dot(f + l->ways + (size_t)w * k, q, k);
            if (all[w] > rooms[w])
                *flag = 1;
        }
        __syncthreads();
        const int any = *flag;
        // Nobody forgets it before all have read it.
        __syncthreads();
        if (!any)
            return;
        // One after the other, by threads that need not wait for each other.
        for (unsigned from = 0; threadIdx.x < WARP && from < l->n_walls; from += WARP) {
            const unsigned own = from + threadIdx.x;
            for (unsigned which = WHICH(own < l->n_walls && all[own] > rooms[own]); which; which &= which - 1) {
                const unsigned w = from + FIRST(which);
                const float gain = f[l->gains + w], room = rooms[w];
                float along = 0.0f;
                for (unsigned i = threadIdx.x; i < k; i += WARP)
                    along += f[l->ways + (size_t)w * k + i] * q[i];
                const float behind = -room - warp_sum(along);
                if (behind > 0.0f)
                    for (unsigned i = threadIdx.x; i < k; i += WARP)
                        q[i] += behind * gain * f[l->pushes + (size_t)w * k + i];
            }
        }
        __syncthreads();
    }
}

// Ties: points that stand for neighbouring cloth do not swing farther apart than cloth between them is long; whether any
// had to be led. `here` holds twelve numbers of every point, `at` room for three; `room` is shared, three rows of MOST.
__device__ int hold_ties(const Layout *l, const float *f, const unsigned *u, const float *here, float *at, float *far,
                         float *q, float *room, volatile int *flag)
{
    const unsigned k = l->n_swings;
    float *first = room, *row = room + MOST, *push = room + 2 * MOST;
    const float *means = f + l->means, *inverse = f + l->inverse;
    int led = 0;
    for (int round = 0; round < ROUNDS; round++) {
        if (threadIdx.x == 0)
            *flag = 0;
        for (unsigned i = threadIdx.x; i < k; i += blockDim.x)
            first[i] = q[i];
        for (unsigned i = threadIdx.x; i < l->n_points; i += blockDim.x) {
            const float *m = here + 12 * i;
            float way[3];
            way_of(means, q, k, i, way);
            for (int j = 0; j < 3; j++)
                at[3 * i + j] = m[9 + j] + m[j] * way[0] + m[3 + j] * way[1] + m[6 + j] * way[2];
        }
        __syncthreads();
        for (unsigned t = threadIdx.x; t < l->n_ties; t += blockDim.x) {
            const unsigned a = u[l->pairs + 2 * t], b = u[l->pairs + 2 * t + 1];
            const float longest = f[l->longest + t];
            float apart = 0.0f, still = 0.0f;
            for (int j = 0; j < 3; j++) {
                const float x = at[3 * b + j] - at[3 * a + j], y = here[12 * b + 9 + j] - here[12 * a + 9 + j];
                apart += x * x;
                still += y * y;
            }
            // What is too long, and else nothing.
            far[t] = 0.0f;
            if (apart > longest * longest) {
                const float most = fmaxf(longest, sqrtf(still)), beyond = sqrtf(apart) - most;
                if (beyond > 0.0f) {
                    far[t] = beyond;
                    *flag = 1;
                }
            }
        }
        __syncthreads();
        const int any = *flag;
        __syncthreads();
        if (!any)
            return led;
        for (unsigned from = 0; threadIdx.x < WARP && from < l->n_ties; from += WARP) {
            const unsigned own = from + threadIdx.x;
            for (unsigned which = WHICH(own < l->n_ties && far[own] != 0.0f); which; which &= which - 1) {
                const unsigned t = from + FIRST(which);
                const unsigned a = u[l->pairs + 2 * t], b = u[l->pairs + 2 * t + 1];
                float d[3], long_ = 0.0f;
                for (int j = 0; j < 3; j++) {
                    d[j] = at[3 * b + j] - at[3 * a + j];
                    long_ += d[j] * d[j];
                }
                long_ = sqrtf(long_);
                const float *ma = here + 12 * a, *mb = here + 12 * b;
                float da[3], db[3];
                for (int j = 0; j < 3; j++) {
                    da[j] = (ma[3 * j] * d[0] + ma[3 * j + 1] * d[1] + ma[3 * j + 2] * d[2]) / long_;
                    db[j] = (mb[3 * j] * d[0] + mb[3 * j + 1] * d[1] + mb[3 * j + 2] * d[2]) / long_;
                }
                float more = 0.0f;
                for (unsigned i = threadIdx.x; i < k; i += WARP) {
                    float sum = 0.0f;
                    for (int j = 0; j < 3; j++)
                        sum += db[j] * means[(size_t)(3 * b + j) * k + i] - da[j] * means[(size_t)(3 * a + j) * k + i];
                    row[i] = sum;
                    more += sum * (q[i] - first[i]);
                }
                const float beyond = far[t] + warp_sum(more);
                if (beyond <= 0.0f)
                    continue;
                TOGETHER();
                float gives = 0.0f;
                for (unsigned i = threadIdx.x; i < k; i += WARP) {
                    push[i] = dot(inverse + (size_t)i * k, row, k);
                    gives += push[i] * row[i];
                }
                const float by = beyond / fmaxf(warp_sum(gives) + l->faint, 1.17549435e-38f);
                for (unsigned i = threadIdx.x; i < k; i += WARP)
                    q[i] -= by * push[i];
                *flag = 2;
                TOGETHER();
            }
        }
        __syncthreads();
        const int any_led = *flag == 2;
        __syncthreads();
        if (!any_led)
            return led;
        led = 1;
    }
    return led;
}

// Codes of the swings, a wearer a block, moment after moment.
__global__ void swing(Layout l, const float *f, const unsigned *u, const float *bones, float *codes, float *state,
                      unsigned *seen, unsigned wearers, unsigned moments, float level)
{
    __shared__ float q[MOST], room[3 * MOST], parts[BLOCK > MOST ? BLOCK : MOST];
    __shared__ volatile int flag;
    const unsigned who = blockIdx.x, k = l.n_swings, n = l.n_points;
    float *now = state + (size_t)who * l.n_state, *before = now + 6 * n;
    float *q1 = before + 6 * n, *q2 = q1 + k, *here = q2 + k, *each = here + 12 * n, *at = each + 3 * n;
    float *rooms = at + 3 * n, *all = rooms + l.n_walls, *far = all + l.n_walls;
    unsigned past = seen[who];
    for (unsigned moment = 0; moment < moments; moment++) {
        const size_t frame = (size_t)moment * wearers + who;
        float *z = codes + frame * l.n_codes;
        const float *a = bones + frame * 12 * l.n_bones;
        for (unsigned i = threadIdx.x; i < n; i += blockDim.x) {
            float p[3];
            laid(f + l.still, f + l.lie, z, l.n_posed, n, i, p);
            carry(u + l.point_bones, f + l.point_weights, u[l.point_starts + i], u[l.point_starts + i + 1], a, p, here + 12 * i);
        }
        __syncthreads();
        if (past < 2) {
            // Cloth that one sees for the first time goes along with the body.
            for (unsigned i = threadIdx.x; i < 3 * n; i += blockDim.x) {
                const unsigned p = i / 3, j = i % 3;
                const float y = here[12 * p + 9 + j];
                const float v = past == 0 ? 0.0f : (y - now[6 * p + j]) / l.step;
                now[6 * p + j] = y;
                now[6 * p + 3 + j] = v;
                before[6 * p + j] = y - v * l.step;
                before[6 * p + 3 + j] = v;
            }
            for (unsigned i = threadIdx.x; i < k; i += blockDim.x) {
                q1[i] = q2[i] = 0.0f;
                z[l.n_posed + i] = 0.0f;
            }
            past++;
            __syncthreads();
            continue;
        }
        // The walls' rooms.
        for (unsigned w = threadIdx.x; w < l.n_walls; w += blockDim.x) {
            float p[3], x[12], out[3], room_ = 0.0f, long_ = 0.0f;
            laid(f + l.wall_still, f + l.wall_lie, z, l.n_posed, l.n_walls, w, p);
            carry(u + l.wall_bones, f + l.wall_weights, u[l.wall_starts + w], u[l.wall_starts + w + 1], a, p, x);
            float foot[12], tip[12];
            carry(u + l.feet_bones, f + l.feet_weights, FOLLOWED * w, FOLLOWED * (w + 1), a, f + l.feet + 6 * w, foot);
            carry(u + l.feet_bones, f + l.feet_weights, FOLLOWED * w, FOLLOWED * (w + 1), a, f + l.feet + 6 * w + 3, tip);
            for (int j = 0; j < 3; j++) {
                out[j] = tip[9 + j] - foot[9 + j];
                long_ += out[j] * out[j];
            }
            for (int j = 0; j < 3; j++)
                room_ += out[j] * (x[9 + j] - foot[9 + j]);
            rooms[w] = fmaxf((long_ > 0.0f ? room_ / sqrtf(long_) : 0.0f) - NEAR, LEAST);
        }
        // What pulls the points, in their own frames.
        for (unsigned i = threadIdx.x; i < n; i += blockDim.x) {
            const float *m = here + 12 * i, *x1 = now + 6 * i, *x2 = before + 6 * i;
            const float by = f[l.masses + i] / (l.tau * l.tau);
            float away[3];
            for (int j = 0; j < 3; j++) {
                const float free_ = (4.0f * x1[j] - x2[j]) / 3.0f + (4.0f * x1[3 + j] - x2[3 + j]) * (l.tau / 3.0f);
                away[j] = free_ - m[9 + j];
            }
            for (int j = 0; j < 3; j++)
                each[3 * i + j] = by * (m[3 * j] * away[0] + m[3 * j + 1] * away[1] + m[3 * j + 2] * away[2]);
        }
        __syncthreads();
        const unsigned lots = blockDim.x / k > 0 ? blockDim.x / k : 1;
        for (unsigned j = threadIdx.x; j < lots * k; j += blockDim.x) {
            float sum = 0.0f;
            for (unsigned r = j / k; r < 3 * n; r += lots)
                sum += f[l.means + (size_t)r * k + j % k] * each[r];
            parts[j] = sum;
        }
        __syncthreads();
        for (unsigned i = threadIdx.x; i < k; i += blockDim.x) {
            float sum = 0.0f;
            for (unsigned j = 0; j < lots; j++)
                sum += parts[j * k + i];
            room[i] = sum + f[l.damping + i] / l.tau * (4.0f * q1[i] - q2[i]) / 3.0f;
            q2[i] = q1[i];
        }
        __syncthreads();
        for (unsigned i = threadIdx.x; i < k; i += blockDim.x)
            q[i] = dot(f + l.inverse + (size_t)i * k, room, k);
        __syncthreads();
        hold_walls(&l, f, rooms, all, q, &flag);
        __syncthreads();
        if (hold_ties(&l, f, u, here, at, far, q, room, &flag)) {
            __syncthreads();
            hold_walls(&l, f, rooms, all, q, &flag);
        }
        __syncthreads();
        for (unsigned i = threadIdx.x; i < k; i += blockDim.x) {
            q1[i] = q[i];
            z[l.n_posed + i] = level * q[i];
        }
        for (unsigned i = threadIdx.x; i < n; i += blockDim.x) {
            const float *m = here + 12 * i;
            float way[3];
            way_of(f + l.means, q, k, i, way);
            for (int j = 0; j < 3; j++) {
                float *x1 = now + 6 * i + j, *x2 = before + 6 * i + j;
                const float x = m[9 + j] + m[j] * way[0] + m[3 + j] * way[1] + m[6 + j] * way[2];
                const float free_ = (4.0f * x1[0] - x2[0]) / 3.0f;
                x2[0] = x1[0];
                x2[3] = x1[3];
                x1[0] = x;
                x1[3] = (x - free_) / l.tau;
            }
        }
        __syncthreads();
    }
    if (threadIdx.x == 0)
        seen[who] = past;
}

// From codes and bones to vertices: a thread a vertex, in FRAMES frames.
__global__ void drape(Layout l, const float *f, const unsigned *u, const float *codes, const float *bones, float *x,
                      unsigned frames)
{
    SHARED(lot);
    float *z = lot, *a = lot + l.n_codes * FRAMES;
    const unsigned first = blockIdx.x * FRAMES, n = l.n_verts;
    for (unsigned i = threadIdx.x; i < l.n_codes * FRAMES; i += blockDim.x) {
        const unsigned k = i / l.n_codes, c = i % l.n_codes;
        z[c * FRAMES + k] = first + k < frames ? codes[(size_t)(first + k) * l.n_codes + c] : 0.0f;
    }
    for (unsigned i = threadIdx.x; i < 12 * l.n_bones * FRAMES; i += blockDim.x) {
        const unsigned k = i / (12 * l.n_bones), c = i % (12 * l.n_bones);
        a[c * FRAMES + k] = first + k < frames ? bones[(size_t)(first + k) * 12 * l.n_bones + c] : 0.0f;
    }
    __syncthreads();
    const unsigned v = blockIdx.y * blockDim.x + threadIdx.x;
    if (v >= n)
        return;
    float p[3][FRAMES], y[3][FRAMES];
    for (int j = 0; j < 3; j++) {
        const float at = f[l.base + j * n + v];
#pragma unroll
        for (int k = 0; k < FRAMES; k++) {
            p[j][k] = at;
            y[j][k] = 0.0f;
        }
    }
    const float *m = f + l.shapes + v;
    for (unsigned c = 0; c < l.n_codes; c++, m += 3 * n) {
        const float m0 = m[0], m1 = m[n], m2 = m[2 * n];
#pragma unroll
        for (int k = 0; k < FRAMES; k++) {
            const float by = z[c * FRAMES + k];
            p[0][k] += m0 * by;
            p[1][k] += m1 * by;
            p[2][k] += m2 * by;
        }
    }
    for (unsigned e = u[l.starts + v]; e < u[l.starts + v + 1]; e++) {
        const float w = f[l.weights + e];
        const float *b = a + 12 * FRAMES * u[l.bones + e];
#pragma unroll
        for (int j = 0; j < 3; j++) {
#pragma unroll
            for (int k = 0; k < FRAMES; k++) {
                const float to = b[j * FRAMES + k] * p[0][k] + b[(3 + j) * FRAMES + k] * p[1][k] + b[(6 + j) * FRAMES + k] * p[2][k];
                y[j][k] += w * (to + b[(9 + j) * FRAMES + k]);
            }
        }
    }
#pragma unroll
    for (int k = 0; k < FRAMES; k++)
        if (first + k < frames)
            for (int j = 0; j < 3; j++)
                x[((size_t)(first + k) * n + v) * 3 + j] = y[j][k];
}

// Unit normals, weighted by area; upwards where no face has any. A thread a vertex, in TURNED frames.
__global__ void turn(Layout l, const unsigned *u, const float *x, float *normals, unsigned frames)
{
    const unsigned v = blockIdx.y * blockDim.x + threadIdx.x, first = blockIdx.x * TURNED;
    if (v >= l.n_verts)
        return;
    const float *own[TURNED];
    float h[TURNED][3], sum[TURNED][3];
#pragma unroll
    for (int k = 0; k < TURNED; k++) {
        // Of a frame that there is, at any rate.
        own[k] = x + (size_t)(first + k < frames ? first + k : first) * l.n_verts * 3;
        for (int j = 0; j < 3; j++) {
            h[k][j] = own[k][3 * v + j];
            sum[k][j] = 0.0f;
        }
    }
    for (unsigned fan = u[l.fans + v]; fan < u[l.fans + v + 1]; fan++) {
        const unsigned from = u[l.spans + fan], to = u[l.spans + fan + 1];
        float last[TURNED][3];
        for (unsigned i = from; i < to; i++) {
            const unsigned at = 3 * u[l.around + i];
#pragma unroll
            for (int k = 0; k < TURNED; k++) {
                float next[3];
                for (int j = 0; j < 3; j++)
                    next[j] = own[k][at + j] - h[k][j];
                if (i > from) {
                    sum[k][0] += last[k][1] * next[2] - last[k][2] * next[1];
                    sum[k][1] += last[k][2] * next[0] - last[k][0] * next[2];
                    sum[k][2] += last[k][0] * next[1] - last[k][1] * next[0];
                }
                for (int j = 0; j < 3; j++)
                    last[k][j] = next[j];
            }
        }
    }
#pragma unroll
    for (int k = 0; k < TURNED; k++) {
        if (first + k >= frames)
            break;
        const float *s = sum[k], square = s[0] * s[0] + s[1] * s[1] + s[2] * s[2];
        const float by = square > 0.0f ? 1.0f / sqrtf(square) : 0.0f;
        float *to = normals + ((size_t)(first + k) * l.n_verts + v) * 3;
        to[0] = by * s[0];
        to[1] = square > 0.0f ? by * s[1] : 1.0f;
        to[2] = by * s[2];
    }
}

#ifdef __CUDACC__
}
#endif
