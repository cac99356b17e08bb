// One whole calibration by a client whose types openapi-typescript made: `node calibrate.ts INPUT.json`.
import { createHash } from 'node:crypto';
import { readFileSync } from 'node:fs';
import createClient from 'openapi-fetch';
import type { components, paths } from './schema';

interface Input {
  url: string;
  token: string;
  fleet: string;
  bag: string;
  rig: components['schemas']['NewRig'];
  region: components['schemas']['DetectionRequest']['region'];
  marks: Record<string, [number, number] | null>;
}

const input = JSON.parse(readFileSync(process.argv[2]!, 'utf-8')) as Input;
const client = createClient<paths>({ baseUrl: input.url, headers: { Authorization: `Bearer ${input.token}` } });

/** The answer, or an error with what the service says. */
async function answered<T>(asked: Promise<{ data?: T; error?: components['schemas']['ProblemDocument'] }>): Promise<T> {
  const { data, error } = await asked;
  if (error || data === undefined) throw new Error(error ? `${error.code}: ${error.detail}` : 'no answer');
  return data;
}

async function ended<T extends { state: string }>(read: () => Promise<T>): Promise<T> {
  for (;;) {
    const row = await read();
    if (['ready', 'done', 'failed', 'cancelled'].includes(row.state)) return row;
    await new Promise((resolve) => setTimeout(resolve, 100));
  }
}

const refused = await client.POST('/v1/fleets/{id}/vehicles', {
  params: { path: { id: input.fleet } },
  body: { name: '' },
});
if (refused.response.status !== 422 || refused.error?.code !== 'invalid_request') throw new Error('no 422');

const vehicle = await answered(
  client.POST('/v1/fleets/{id}/vehicles', { params: { path: { id: input.fleet } }, body: { name: 'by TypeScript' } }),
);
const of = { params: { path: { id: vehicle.id } } };
const rig = await answered(client.POST('/v1/vehicles/{id}/rigs', { ...of, body: input.rig }));
const bag = readFileSync(input.bag);
const made = await answered(
  client.POST('/v1/vehicles/{id}/recordings', {
    ...of,
    body: { name: 'walk', file_name: 'walk.bag', rig_id: rig.id, size: bag.length },
  }),
);
const digest = createHash('sha256').update(bag);
await answered(
  client.PUT('/v1/recordings/{id}/parts/{number}', {
    params: {
      path: { id: made.id, number: 1 },
      header: { 'Content-Digest': `sha-256=:${digest.copy().digest('base64')}:` },
    },
    body: bag as unknown as string,
    bodySerializer: (body) => body,
    headers: { 'Content-Type': 'application/octet-stream' },
  }),
);
const path = { id: made.id };
await answered(
  client.POST('/v1/recordings/{id}/complete', {
    params: { path },
    body: { parts: 1, size: bag.length, sha256: digest.digest('hex') },
  }),
);
const recording = await ended(() => answered(client.GET('/v1/recordings/{id}', { params: { path } })));
if (recording.state !== 'ready') throw new Error(JSON.stringify(recording.problem));

const asked = await answered(
  client.POST('/v1/recordings/{recording_id}/detections', {
    params: { path: { recording_id: made.id } },
    body: { region: input.region, detector: 'tolerant' },
  }),
);
const inDetection = { params: { path: { detection_id: asked.id } } };
await ended(() => answered(client.GET('/v1/detections/{detection_id}', inDetection)));
for (;;) {
  const { data: task, response } = await client.POST('/v1/detections/{detection_id}/tasks/next', {
    ...inDetection,
    body: { camera: 'front' },
  });
  if (!task || response.status === 204) break;
  const pixel = input.marks[task.frame.index];
  await answered(
    client.POST('/v1/tasks/{task_id}/answer', {
      params: { path: { task_id: task.task_id } },
      body: {
        id: crypto.randomUUID(),
        version: 0,
        ...(pixel ? { verdict: 'confirmed', mark: { u: pixel[0], v: pixel[1] } } : { verdict: 'rejected' }),
      },
    }),
  );
}
const pairs = await answered(
  client.POST('/v1/detections/{detection_id}/correspondence-sets', { ...inDetection, body: { camera: 'front' } }),
);
const started = await answered(
  client.POST('/v1/vehicles/{vehicle_id}/calibrations', {
    params: { path: { vehicle_id: vehicle.id } },
    body: {
      correspondence_set_ids: [pairs.id],
      models: ['pinhole'],
      folds: 0,
      schedule: { slots: 2, population: 200, generations: 20, max_iterations: 3 },
    },
  }),
);
const calibration = await ended(() =>
  answered(client.GET('/v1/calibrations/{calibration_id}', { params: { path: { calibration_id: started.id } } })),
);
const fit = calibration.summary?.cameras['front']?.models['pinhole'];
if (!fit) throw new Error(JSON.stringify(calibration.problem));
const ofResult = { params: { path: { result_id: fit.result_id } } };
await answered(
  client.POST('/v1/results/{result_id}/publication', { ...ofResult, body: { override: { reason: 'a short walk' } } }),
);
const exported = await client.GET('/v1/results/{result_id}', {
  params: { ...ofResult.params, query: { format: 'ros2' } },
  parseAs: 'arrayBuffer',
});
const validation = await answered(
  client.POST('/v1/analyses', { body: { kind: 'pair_validation', set_id: pairs.id, result_id: fit.result_id } }),
);
const checked = await ended(() =>
  answered(client.GET('/v1/analyses/{analysis_id}', { params: { path: { analysis_id: validation.id } } })),
);
console.log(
  JSON.stringify({
    pairs: pairs.count,
    rms_px: fit.polished.rms_px,
    exported: exported.response.status,
    validated: checked.kind === 'pair_validation' && checked.result?.pairs,
  }),
);
