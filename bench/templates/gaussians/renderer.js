// The renderer's passes in a browser: the same shaders in the same order as on wgpu, with one sub-frame per frame.

const GROUP = 256, RADIX_BLOCK = 4096, SCAN_BLOCK = 1024, TILE = 8;
const blocksOf = (count, size) => Math.ceil(count / size);

class GaussianRenderer {
  // A device with the adapter's limits; null if the browser or the machine has none. `unpacked` returns the Gaussians.
  static async open(unpacked, shaders) {
    const adapter = navigator.gpu ? await navigator.gpu.requestAdapter({ powerPreference: 'high-performance' }) : null;
    if (!adapter) { return null; }
    const { maxStorageBufferBindingSize, maxBufferSize } = adapter.limits;
    const device = await adapter.requestDevice({ requiredLimits: { maxStorageBufferBindingSize, maxBufferSize } });
    const limit = Math.min(maxStorageBufferBindingSize, maxBufferSize);
    const gaussians = await unpacked();
    if (Math.max(gaussians.count * 16, gaussians.coefficients.byteLength) > limit) { throw new Error(gaussians.count + ' Gaussians do not fit a binding of this adapter'); }
    return new GaussianRenderer(device, limit, gaussians, shaders);
  }

  constructor(device, limit, gaussians, shaders) {
    Object.assign(this, { device, limit, count: gaussians.count, transient: [] });
    const modules = new Map(shaders.map(([name, code]) => [name, device.createShaderModule({ label: name, code })]));
    const pass = (name, entryPoint) => device.createComputePipeline({
      label: entryPoint, layout: 'auto', compute: { module: modules.get(name), entryPoint },
    });
    this.passes = {
      project: pass('project', 'project'), scanBlocks: pass('scan', 'scan_blocks'), addSums: pass('scan', 'add_sums'),
      histogram: pass('radix', 'radix_histogram'), scatter: pass('radix', 'radix_scatter'), countTiles: pass('emit', 'count_tiles'),
      harmonics: pass('harmonics', 'harmonics'), emit: pass('emit', 'emit'), findRanges: pass('ranges', 'find_ranges'), raster: pass('raster', 'raster'),
    };
    const screen = modules.get('screen');
    this.screen = device.createRenderPipeline({
      layout: 'auto', vertex: { module: screen, entryPoint: 'corner' },
      fragment: { module: screen, entryPoint: 'shade', targets: [{ format: 'rgba8unorm' }] },
    });
    const n = this.count;
    const filled = (data) => {
      const buffer = this.storage(data.byteLength);
      device.queue.writeBuffer(buffer, 0, data);
      return buffer;
    };
    this.scene = {
      means: filled(gaussians.means), quaternions: filled(gaussians.quaternions), scales: filled(gaussians.scales), colors: filled(gaussians.colors),
      coefficients: filled(gaussians.coefficients), seen: this.storage(n * 16),
      splats: this.storage(n * 16), details: this.storage(n * 16), footprints: this.storage(n * 8), dropped: this.storage(32),
      places: this.storage((n + 1) * 4), sums: this.sums(n + 1),
    };
    this.byDepth = this.sorter(n);
    this.pairs = null;
    this.target = { pixels: 0 };
  }

  storage(bytes) {
    const usage = GPUBufferUsage.STORAGE | GPUBufferUsage.COPY_DST | GPUBufferUsage.COPY_SRC;
    return this.device.createBuffer({ size: Math.max(16, Math.ceil(bytes / 4) * 4), usage });
  }

  // Lives until the end of the frame.
  uniform(words) {
    const buffer = this.device.createBuffer({ size: words.byteLength, usage: GPUBufferUsage.UNIFORM | GPUBufferUsage.COPY_DST });
    this.device.queue.writeBuffer(buffer, 0, words);
    this.transient.push(buffer);
    return buffer;
  }

  bindings(pipeline, buffers) {
    const entries = buffers.map((buffer, binding) => ({ binding, resource: { buffer } }));
    return this.device.createBindGroup({ layout: pipeline.getBindGroupLayout(0), entries });
  }

  run(encoder, pipeline, buffers, groups) {
    const [x, y] = Array.isArray(groups) ? groups : [Math.min(groups, 65535), Math.ceil(groups / 65535)];
    if (x * y === 0) { return; }
    const pass = encoder.beginComputePass();
    pass.setPipeline(pipeline);
    pass.setBindGroup(0, this.bindings(pipeline, buffers));
    pass.dispatchWorkgroups(x, y);
    pass.end();
  }

  sums(entries) {
    const levels = [];
    for (let blocks = blocksOf(entries, SCAN_BLOCK); ; blocks = blocksOf(blocks, SCAN_BLOCK)) {
      levels.push(this.storage(blocks * 4));
      if (blocks <= 1) { return levels; }
    }
  }

  // Exclusive prefix sums in place; the totals of the blocks are stored in `copy` if given.
  scan(encoder, data, count, sums, copy, level = 0) {
    const blocks = blocksOf(count, SCAN_BLOCK);
    const params = this.uniform(new Uint32Array([count, 0, 0, 0]));
    this.run(encoder, this.passes.scanBlocks, [params, data, sums[level]], blocks);
    if (copy) { encoder.copyBufferToBuffer(sums[level], 0, copy, 0, blocks * 4); }
    if (blocks > 1) {
      this.scan(encoder, sums[level], blocks, sums, null, level + 1);
      this.run(encoder, this.passes.addSums, [params, data, sums[level]], blocks);
    }
  }

  sorter(capacity) {
    const make = () => this.storage(capacity * 4);
    const entries = blocksOf(capacity, RADIX_BLOCK) * 256;
    return { capacity, keys: [make(), make()], values: [make(), make()], histogram: this.storage(entries * 4), sums: this.sums(entries) };
  }

  // Sorts by the low `bits` bits of the keys; returns the half that contains the result.
  sort(encoder, sorter, count, bits, identity) {
    const blocks = blocksOf(count, RADIX_BLOCK);
    let from = 0;
    for (let shift = 0; shift < bits; shift += 8) {
      const { keys, values, histogram, sums } = sorter;
      const params = this.uniform(new Uint32Array([count, shift, blocks, identity && shift === 0 ? 1 : 0]));
      const buffers = [params, keys[from], histogram, values[from], keys[1 - from], values[1 - from]];
      this.run(encoder, this.passes.histogram, buffers.slice(0, 3), blocks);
      this.scan(encoder, histogram, blocks * 256, sums, null);
      this.run(encoder, this.passes.scatter, buffers, blocks);
      from = 1 - from;
    }
    return from;
  }

  async read(encoder, staging, bytes) {
    this.device.queue.submit([encoder.finish()]);
    await staging.mapAsync(GPUMapMode.READ, 0, bytes);
    const copy = staging.getMappedRange(0, bytes).slice(0);
    staging.destroy();
    return copy;
  }

  staging(bytes) {
    return this.device.createBuffer({ size: bytes, usage: GPUBufferUsage.MAP_READ | GPUBufferUsage.COPY_DST });
  }

  // Whether a picture of this size fits into one binding.
  fits(width, height) {
    return blocksOf(width, TILE) * blocksOf(height, TILE) * TILE * TILE * 16 <= this.limit;
  }

  // Rasterises a view: { rows [3][4] from scene to camera, eye, focal, center, bounds, width, height, eps2d, near, far, alphaMax,
  // compensation, tiled, degree, encoded }.
  async draw(view) {
    const { device, scene, passes, byDepth, count } = this;
    let encoder = device.createCommandEncoder();
    const rest = view.rows[2].map((value) => value - Math.fround(value));
    const words = new Float32Array([
      ...view.rows.flat(), ...rest, ...view.focal, ...view.center, ...view.bounds,
      view.width, view.height, view.eps2d, view.near, view.far, ...new Array(7).fill(0), ...view.eye, 0,
    ]);
    const stored = (view.degree + 1) ** 2 - 1;
    new Uint32Array(words.buffer).set([count, 0, view.compensation, view.tiled ? 1 : 0, view.degree, stored], 29);
    const uniform = this.uniform(words);
    const { means, quaternions, scales, coefficients, seen, splats, details, footprints, dropped, places, sums } = scene;
    const colors = view.encoded ? seen : scene.colors;
    if (view.encoded) { this.run(encoder, passes.harmonics, [uniform, means, scene.colors, coefficients, seen], blocksOf(count, GROUP)); }
    this.run(encoder, passes.project, [
      uniform, means, quaternions, scales, splats, details, footprints, byDepth.keys[0], dropped,
    ], blocksOf(count, GROUP));
    const order = byDepth.values[this.sort(encoder, byDepth, count, 32, true)];
    const tiles = [blocksOf(view.width, TILE), blocksOf(view.height, TILE)];
    const frame = (pairs) => {
      const words = new Uint32Array([0, 0, ...tiles, count, pairs, Math.log2(TILE), 0]);
      new Float32Array(words.buffer)[7] = view.alphaMax;
      return this.uniform(words);
    };
    this.run(encoder, passes.countTiles, [frame(0), order, footprints, places], blocksOf(count + 1, GROUP));
    const bytes = blocksOf(count + 1, SCAN_BLOCK) * 4;
    const staging = this.staging(bytes);
    this.scan(encoder, places, count + 1, sums, staging);
    const pairs = new Uint32Array(await this.read(encoder, staging, bytes)).reduce((sum, block) => sum + block, 0);
    if (pairs * 4 > this.limit) { throw new Error(pairs + ' pairs of tile and Gaussian do not fit a binding of this adapter'); }

    const pixels = tiles[0] * tiles[1] * TILE * TILE;
    if (pixels > this.target.pixels) {
      [this.target.ranges, this.target.picture, this.target.depths].forEach((buffer) => buffer && buffer.destroy());
      this.target = {
        pixels, ranges: this.storage(tiles[0] * tiles[1] * 8), picture: this.storage(pixels * 16), depths: this.storage(pixels * 4),
      };
    }
    if (!this.pairs || pairs > this.pairs.capacity) {
      if (this.pairs) { [...this.pairs.keys, ...this.pairs.values, this.pairs.histogram, ...this.pairs.sums].forEach((buffer) => buffer.destroy()); }
      this.pairs = this.sorter(Math.min(Math.ceil(pairs * 1.25), Math.floor(this.limit / 4)));
    }
    const { keys, values } = this.pairs;
    const { ranges, picture, depths } = this.target;
    encoder = device.createCommandEncoder();
    encoder.clearBuffer(ranges);
    let half = 0;
    if (pairs > 0) {
      this.run(encoder, passes.emit, [frame(pairs), order, footprints, places, keys[0], values[0]], blocksOf(count, GROUP));
      half = this.sort(encoder, this.pairs, pairs, 32 - Math.clz32(tiles[0] * tiles[1] - 1), false);
      this.run(encoder, passes.findRanges, [frame(pairs), keys[half], ranges], blocksOf(pairs, GROUP));
    }
    this.run(encoder, passes.raster, [frame(pairs), ranges, values[half], splats, details, colors, picture, depths], [tiles[0], blocksOf(tiles[1], 4)]);
    device.queue.submit([encoder.finish()]);
    this.drawn = { width: view.width, height: view.height, stride: tiles[0] * TILE };
  }

  // The last picture, 8 bit. Read back instead of presented by the GPU, because a 2D canvas works wherever a device does.
  async levels(look) {
    const { device, screen } = this;
    const { width, height, stride } = this.drawn;
    const words = new Float32Array(12);
    words.set(look.background, 4);
    words.set(look.inverseDepth, 8);
    new Uint32Array(words.buffer).set([width, height, stride, look.shown]);
    new Uint32Array(words.buffer)[7] = look.truncate ? 1 : 0;
    new Uint32Array(words.buffer)[10] = look.encoded ? 1 : 0;
    const usage = GPUTextureUsage.RENDER_ATTACHMENT | GPUTextureUsage.COPY_SRC;
    const texture = device.createTexture({ size: [width, height], format: 'rgba8unorm', usage });
    const bytesPerRow = Math.ceil(width / 64) * 256;
    const staging = this.staging(bytesPerRow * height);
    const encoder = device.createCommandEncoder();
    const pass = encoder.beginRenderPass({ colorAttachments: [{ view: texture.createView(), loadOp: 'clear', storeOp: 'store' }] });
    pass.setPipeline(screen);
    pass.setBindGroup(0, this.bindings(screen, [this.uniform(words), this.target.picture, this.target.depths]));
    pass.draw(3);
    pass.end();
    encoder.copyTextureToBuffer({ texture }, { buffer: staging, bytesPerRow }, [width, height]);
    const rows = new Uint8ClampedArray(await this.read(encoder, staging, bytesPerRow * height));
    texture.destroy();
    this.transient.splice(0).forEach((buffer) => buffer.destroy());
    const image = new ImageData(width, height);
    for (let y = 0; y < height; y++) { image.data.set(rows.subarray(y * bytesPerRow, y * bytesPerRow + width * 4), y * width * 4); }
    return image;
  }
}
