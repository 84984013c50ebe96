// An object store in a folder. Usage: node --openssl-legacy-provider serve.cjs MODULES FOLDER BUCKET; prints its address.
// (It makes the tokens of long listings with DES.)
const { createRequire } = require('node:module');
const [modules, folder, bucket] = process.argv.slice(2);
const S3rver = createRequire(`${modules}/`)('@20minutes/s3rver');

new S3rver({ address: '127.0.0.1', port: 0, directory: folder, silent: true, configureBuckets: [{ name: bucket, configs: [] }] })
  .run()
  .then(({ port }) => console.log(`http://127.0.0.1:${port}`));
