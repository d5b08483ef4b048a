// Runs the kernels on this machine's processor: a thread for each of a block's, one block after the other.
//
// What it is to run comes through a pipe, what came of it goes back through one; `cuda.rs`'s tests talk to it.

#define _XOPEN_SOURCE 700
#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

// Threads in a block here.
#define BLOCK 4
#ifndef FRAMES
#define FRAMES 4
#endif

typedef struct {
    unsigned x, y;
} Place;
static __thread Place threadIdx, blockIdx;
static Place blockDim = {BLOCK, 1};
static pthread_barrier_t together;

#define __global__ static
#define __device__ static
#define __shared__ static
#define __syncthreads() pthread_barrier_wait(&together)
static float shared[1 << 16];
#define SHARED(name) float *name = shared

#define WARP 1
#define warp_sum(x) (x)
#define WHICH(yes) ((yes) ? 1u : 0u)
#define FIRST(which) 0
#define TOGETHER()

#include "kernels.cu"

// A kernel with what it is called with.
static void (*call)(void);
static Place grid;

static void *work(void *number)
{
    threadIdx.x = (unsigned)(size_t)number;
    for (unsigned y = 0; y < grid.y; y++)
        for (unsigned x = 0; x < grid.x; x++) {
            blockIdx.x = x;
            blockIdx.y = y;
            call();
            __syncthreads();
        }
    return 0;
}

static void launch(void (*kernel)(void), unsigned x, unsigned y)
{
    pthread_t threads[BLOCK];
    call = kernel;
    grid.x = x;
    grid.y = y;
    for (size_t i = 0; i < BLOCK; i++)
        if (pthread_create(&threads[i], 0, work, (void *)i))
            exit(3);
    for (size_t i = 0; i < BLOCK; i++)
        pthread_join(threads[i], 0);
}

// All that is told, in this order: numbers; the layout; arrays of the model; widths and parameters of the network; inputs
// and bones of all frames.
static struct {
    unsigned wearers, moments, n_f, n_u, n_layers, bend, bends_last;
    float level;
} told;
static Layout l;
static float *f, *params, *in, *out, *bones, *codes, *state, *x, *normals;
static unsigned *u, *widths, *seen, frames, at, stride, bend;

static void *gulp(size_t count, int is_told)
{
    // One more, so that nothing is a place too.
    void *to = calloc(count + 1, 4);
    if (!to || (is_told && fread(to, 4, count, stdin) != count))
        exit(2);
    return to;
}

static void one_layer(void)
{
    layer(params, in, out, widths[at], widths[at + 1], stride, frames, bend);
}
static void swings(void)
{
    swing(l, f, u, bones, codes, state, seen, told.wearers, told.moments, told.level);
}
static void draped(void)
{
    drape(l, f, u, codes, bones, x, frames);
}
static void turned(void)
{
    turn(l, u, x, normals, frames);
}

static unsigned lots(unsigned n, unsigned by)
{
    return (n + by - 1) / by;
}

int main(void)
{
    pthread_barrier_init(&together, 0, BLOCK);
    if (fread(&told, sizeof told, 1, stdin) != 1 || fread(&l, sizeof l, 1, stdin) != 1)
        return 2;
    f = gulp(told.n_f, 1);
    u = gulp(told.n_u, 1);
    widths = gulp(told.n_layers + 1, 1);
    size_t n_params = 0;
    for (unsigned k = 0; k < told.n_layers; k++)
        n_params += (size_t)(widths[k] + 1) * widths[k + 1];
    params = gulp(n_params, 1);
    frames = told.wearers * told.moments;
    in = gulp((size_t)frames * widths[0], 1);
    bones = gulp((size_t)frames * 12 * l.n_bones, 1);
    codes = gulp((size_t)frames * l.n_codes, 0);
    state = gulp((size_t)told.wearers * l.n_state, 0);
    seen = gulp(told.wearers, 0);
    x = gulp((size_t)frames * 3 * l.n_verts, 0);
    normals = gulp((size_t)frames * 3 * l.n_verts, 0);
    for (at = 0; at < told.n_layers; at++) {
        const int last = at + 1 == told.n_layers;
        stride = last ? l.n_codes : widths[at + 1];
        bend = !last || told.bends_last ? told.bend : 0;
        out = last ? codes : gulp((size_t)frames * stride, 0);
        launch(one_layer, lots(frames, 8), lots(widths[at + 1], BLOCK));
        params += (size_t)(widths[at] + 1) * widths[at + 1];
        in = out;
    }
    if (l.n_swings)
        launch(swings, told.wearers, 1);
    launch(draped, lots(frames, FRAMES), lots(l.n_verts, BLOCK));
    launch(turned, lots(frames, TURNED), lots(l.n_verts, BLOCK));
    const size_t n = (size_t)frames * 3 * l.n_verts;
    return fwrite(x, 4, n, stdout) == n && fwrite(normals, 4, n, stdout) == n ? 0 : 4;
}
