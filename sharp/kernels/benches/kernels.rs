//! Rates of the kernels at the shapes of the network and of the metrics' backbones.
//!
//! `cargo bench -p sharp-kernels`; criterion's throughput is in multiply-adds, counted as the
//! direct sum has them: twice that is the FLOP/s that others print.

use std::hint::black_box;
use std::time::Duration;

use criterion::{BenchmarkGroup, Criterion, Throughput, criterion_group, criterion_main};
use sharp_kernels::{
    Algorithm, Conv2d, ConvSpec, Epilogue, PackedMatrix, RowOp, RowWindow, Simd, Workspace, matmul,
};

fn values(len: usize) -> Vec<f32> {
    (0..len)
        .map(|i| ((i * 7919) % 1000) as f32 / 500.0 - 1.0)
        .collect()
}

fn short(group: &mut BenchmarkGroup<'_, criterion::measurement::WallTime>) {
    group
        .sample_size(10)
        .warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_secs(2));
}

fn products(c: &mut Criterion) {
    let mut group = c.benchmark_group("matmul");
    short(&mut group);
    for (m, k, n) in [(577, 1024, 3072), (577, 4096, 1024)] {
        let (a, w) = (values(m * k), values(n * k));
        let mut out = vec![0.0; m * n];
        group.throughput(Throughput::Elements((m * k * n) as u64));
        for simd in Simd::available() {
            let packed = PackedMatrix::from_out_in(simd, &w, None, n, k);
            let mut workspace = Workspace::new();
            group.bench_function(format!("{}/{m}x{k}x{n}", simd.level()), |b| {
                b.iter(|| {
                    let epilogue = Epilogue::None;
                    matmul(
                        black_box(&a),
                        &packed,
                        &mut out,
                        m,
                        epilogue,
                        &mut workspace,
                    );
                });
            });
        }
        group.bench_function(format!("gemm-crate/{m}x{k}x{n}"), |b| {
            b.iter(|| {
                let (threads, n_stride, k_stride) = (rayon::current_num_threads(), n, k);
                // SAFETY: the three matrices have the lengths their strides say.
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

fn convolutions(c: &mut Criterion) {
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
        group.throughput(Throughput::Elements((9 * channels * image.len()) as u64));
        for simd in Simd::available() {
            for algorithm in [Algorithm::Direct, Algorithm::Winograd] {
                let conv = Conv2d::new(simd, spec, &weight, None, true, algorithm);
                let mut workspace = Workspace::new();
                let name = format!("{}/{algorithm:?}/{channels}", simd.level());
                group.bench_function(name, |b| {
                    b.iter(|| {
                        conv.run_rows(black_box(&window), 0..height, &mut out, &mut workspace);
                    });
                });
            }
        }
    }
    group.finish();
}

criterion_group!(benches, products, convolutions);
criterion_main!(benches);
