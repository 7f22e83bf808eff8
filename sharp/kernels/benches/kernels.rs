//! Rates of the kernels at the shapes of the network and of the metrics' backbones.
//!
//! `cargo bench -p sharp-kernels`. Times are CPU time of the process, summed over threads. Rates are floating-point
//! operations (shown as elements) per second of CPU time, where operations are counted as in the direct sum, so that
//! the rate of Winograd's convolutions, which need fewer operations, may exceed the machine's peak.

#[path = "../../benches/cpu_time/mod.rs"]
mod cpu_time;

use std::hint::black_box;
use std::time::Duration;

use self::cpu_time::CpuTime;
use criterion::{BenchmarkGroup, Criterion, Throughput, criterion_group, criterion_main};
use sharp_kernels::{
    Algorithm, AttentionShape, Conv2d, ConvSpec, Epilogue, GroupNorm, PackedMatrix, RowOp,
    RowWindow, Simd, attention, matmul,
};

type Group<'a> = BenchmarkGroup<'a, CpuTime>;

fn values(len: usize) -> Vec<f32> {
    (0..len)
        .map(|i| ((i * 7919) % 1000) as f32 / 500.0 - 1.0)
        .collect()
}

fn short(group: &mut Group<'_>) {
    group
        .sample_size(10)
        .warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_secs(2));
}

/// Floating-point operations of a kernel, which are shown as elements.
fn flop(multiply_adds: usize) -> Throughput {
    Throughput::Elements(2 * multiply_adds as u64)
}

fn products(c: &mut Criterion<CpuTime>) {
    let mut group = c.benchmark_group("matmul");
    short(&mut group);
    for (m, k, n) in [(577, 1024, 3072), (577, 4096, 1024)] {
        let (a, w) = (values(m * k), values(n * k));
        let mut out = vec![0.0; m * n];
        group.throughput(flop(m * k * n));
        for simd in Simd::available() {
            let packed = PackedMatrix::from_out_in(simd, &w, None, n, k);
            group.bench_function(format!("{}/{m}x{k}x{n}", simd.instruction_set()), |b| {
                b.iter(|| {
                    let epilogue = Epilogue::None;
                    matmul(black_box(&a), &packed, &mut out, m, epilogue);
                });
            });
        }
        group.bench_function(format!("gemm-crate/{m}x{k}x{n}"), |b| {
            b.iter(|| {
                let (threads, n_stride, k_stride) = (rayon::current_num_threads(), n, k);
                // SAFETY: the three matrices have the lengths given by their strides.
                unsafe {
                    gemm::gemm(
                        m,
                        n,
                        k,
                        out.as_mut_ptr(),
                        1,
                        n_stride as isize,
                        false,
                        black_box(&a).as_ptr(),
                        1,
                        k_stride as isize,
                        w.as_ptr(),
                        k_stride as isize,
                        1,
                        0.0,
                        1.0,
                        false,
                        false,
                        false,
                        gemm::Parallelism::Rayon(threads),
                    );
                }
            });
        });
    }
    group.finish();
}

fn convolutions(c: &mut Criterion<CpuTime>) {
    let mut group = c.benchmark_group("conv3x3");
    short(&mut group);
    for (channels, height, width) in [(64, 64, 1752), (256, 48, 438), (512, 40, 219)] {
        let spec = ConvSpec {
            in_channels: channels,
            out_channels: channels,
            kernel: 3,
            stride: 1,
            padding: 1,
        };
        let (image, weight) = (values(height * width * channels), values(spec.weight_len()));
        let mut out = vec![0.0; image.len()];
        let window = RowWindow::whole(&image, height, width, channels);
        group.throughput(flop(9 * channels * image.len()));
        for simd in Simd::available() {
            for algorithm in [Algorithm::Direct, Algorithm::Winograd] {
                let conv = Conv2d::new(simd, spec, &weight, None, true, algorithm);
                let name = format!("{}/{algorithm:?}/{channels}", simd.instruction_set());
                group.bench_function(name, |b| {
                    b.iter(|| {
                        conv.run_rows(black_box(&window), 0..height, &mut out);
                    });
                });
            }
        }
    }
    group.finish();
}

fn transformer(c: &mut Criterion<CpuTime>) {
    let mut group = c.benchmark_group("attention");
    short(&mut group);
    let shape = AttentionShape {
        batch: 1,
        tokens: 577,
        heads: 16,
        head_dim: 64,
    };
    let qkv = values(3 * shape.tokens * shape.dim());
    let mut out = vec![0.0; shape.tokens * shape.dim()];
    group.throughput(flop(2 * shape.tokens * shape.tokens * shape.dim()));
    for simd in Simd::available() {
        group.bench_function(format!("{}", simd.instruction_set()), |b| {
            b.iter(|| attention(simd, black_box(&qkv), &mut out, shape, 0.125));
        });
    }
    group.finish();

    let mut group = c.benchmark_group("group_norm");
    short(&mut group);
    let (pixels, channels) = (384 * 384, 128);
    let x = values(pixels * channels);
    let mut out = vec![0.0; x.len()];
    let norm = GroupNorm::new(8, &vec![1.0; channels], &vec![0.0; channels], 1e-5);
    group.throughput(flop(x.len()));
    for simd in Simd::available() {
        group.bench_function(format!("{}", simd.instruction_set()), |b| {
            b.iter(|| norm.run(simd, black_box(&x), true, &mut out));
        });
    }
    group.finish();
}

criterion_group! {
    name = benches;
    config = Criterion::default().with_measurement(CpuTime);
    targets = products, convolutions, transformer
}
criterion_main!(benches);
